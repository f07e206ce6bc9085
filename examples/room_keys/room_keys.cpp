// Room keys: a stack whose robots never wait in a corridor.
//
// A robot stands in a room or at its own parking place, or it is on its way from one to the other.
// It leaves only once it has the key of the room that it wants, of which there is one, and a way
// that comes near no way of another robot. Who has waited longest chooses first. Two robots that
// want each other's rooms would wait for ever: the one that is later in the list steps out.
//
// Build it by: c++ -std=c++17 -O2 -I../../simulator_interface/clients -o room_keys room_keys.cpp
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "mrta_stack.hpp"

constexpr double SPEED = 0.7;     // m/s
constexpr double TURNING = 1.5;   // rad/s, at most
constexpr double AHEAD = 0.4;     // m; how far along its way a robot aims
constexpr double ARRIVED = 0.2;   // m
constexpr double APART = 0.8;     // m between two ways that robots drive at a time
constexpr double IN_FRONT = 1.0;  // m; a robot stops for people who are nearer than this
constexpr double ASIDE = 0.6;     // m to the side, for the same
constexpr int ASK_EVERY = 5;      // ticks between two questions for a way

struct Point {
    double x, y;
};

double distance(const Point& a, const Point& b) { return std::hypot(a.x - b.x, a.y - b.y); }

struct Stop {
    int room;           // -1: its parking place
    const char* claim;  // once it is done, nullptr: nothing
    double service;     // s
    int task;
};

struct Robot {
    Point home{};
    double joins_at = 0.0;         // s
    std::string name;
    Point here{};
    double yaw = 0.0;
    bool on_floor = true;          // false: it was carried away, and holds nothing
    int key = -1;                  // room that it stands in or drives to
    bool drives = false;
    std::vector<Point> way;        // that is left to drive
    std::deque<Stop> stops;
    double since = -1.0;           // when it arrived at the first stop [s], before: negative
    double waits_since = 0.0;      // [s]
};

class RoomKeys {
public:
    RoomKeys(const mrta::Value& world, mrta::Harness& harness)
        : harness_(harness), bounds_(world["bounds"].numbers()) {
        if (world["params"].has("longest_ring")) longest_ring_ = world["params"]["longest_ring"].integer();
        for (const mrta::Value& room : world["rooms"].list) {
            const auto point = room["point"].numbers();
            rooms_.push_back({point[0], point[1]});
            names_.push_back(room["name"].text);
        }
        const auto& spots = world["parking"].list;
        for (const mrta::Value& told : world["robots"].list) {
            Robot robot;
            const auto home = (robots_.size() < spots.size() ? spots[robots_.size()] : told["pose"]).numbers();
            robot.home = {home[0], home[1]};
            robot.joins_at = told["joins_at"].number();
            robot.name = told["name"].text;
            const auto pose = told["pose"].numbers();
            for (std::size_t k = 0; k < rooms_.size(); ++k)
                if (distance({pose[0], pose[1]}, rooms_[k]) < 1.0) robot.key = static_cast<int>(k);
            robots_.push_back(robot);
        }
    }

    mrta::Command step(const mrta::Tick& tick) {
        mrta::Command command;
        command.twist.assign(3 * robots_.size(), 0.0);
        command.goal.assign(2 * robots_.size(), std::numeric_limits<double>::quiet_NaN());
        command.stops_left.assign(robots_.size(), 0);
        look(tick);
        assign(tick);
        for (std::size_t i = 0; i < robots_.size(); ++i) serve(tick, i, command);
        set_out(tick, command);
        for (std::size_t i = 0; i < robots_.size(); ++i) {
            if (robots_[i].drives) drive(tick, i, command);
            if (robots_[i].stops.empty()) continue;
            command.goal[2 * i] = goal(robots_[i]).x;
            command.goal[2 * i + 1] = goal(robots_[i]).y;
            command.stops_left[i] = static_cast<int>(robots_[i].stops.size());
        }
        return command;
    }

private:
    mrta::Harness& harness_;
    std::vector<double> bounds_;
    int longest_ring_ = 2;  // of robots that want each other's rooms, that it looks for
    std::vector<Point> rooms_;
    std::vector<std::string> names_;
    std::vector<Robot> robots_;
    std::deque<mrta::Task> tasks_;  // that no robot has taken

    Point goal(const Robot& robot) const {
        const int room = robot.stops.front().room;
        return room < 0 ? robot.home : rooms_.at(static_cast<std::size_t>(room));
    }

    void look(const mrta::Tick& tick) {
        for (std::size_t i = 0; i < robots_.size(); ++i) {
            Robot& robot = robots_[i];
            robot.here = {tick.pose[3 * i], tick.pose[3 * i + 1]};
            robot.yaw = tick.pose[3 * i + 2];
            robot.on_floor = robot.here.x > bounds_[0] && robot.here.y > bounds_[1] && robot.here.x < bounds_[2]
                && robot.here.y < bounds_[3];
        }
    }

    // Give each task to the nearest robot that has nothing to do.
    void assign(const mrta::Tick& tick) {
        tasks_.insert(tasks_.end(), tick.tasks.begin(), tick.tasks.end());
        for (auto task = tasks_.begin(); task != tasks_.end();) {
            const Point start = rooms_.at(static_cast<std::size_t>(task->start));
            Robot* nearest = nullptr;
            for (Robot& robot : robots_) {
                const bool is_free = robot.stops.empty() || (robot.stops.front().room < 0 && robot.stops.size() == 1);
                if (!is_free || robot.drives || tick.time < robot.joins_at) continue;
                if (!task->robot.empty() && task->robot != robot.name) continue;
                if (nearest == nullptr || distance(robot.here, start) < distance(nearest->here, start)) nearest = &robot;
            }
            if (nearest == nullptr) {
                ++task;
                continue;
            }
            nearest->waits_since = tick.time;
            nearest->stops = {{task->start, "picked-up", task->pickup_time, task->task},
                              {task->end, "dropped-off", task->dropoff_time, task->task}};
            task = tasks_.erase(task);
        }
    }

    // Claim a stop once the robot has stood there; with nothing more to do it goes home.
    void serve(const mrta::Tick& tick, std::size_t i, mrta::Command& command) {
        Robot& robot = robots_[i];
        if (robot.drives || tick.time < robot.joins_at) return;
        if (robot.stops.empty()) {
            if (distance(robot.here, robot.home) > 2 * ARRIVED) robot.stops.push_back({-1, nullptr, 0.0, -1});
            return;
        }
        const Stop stop = robot.stops.front();
        if (robot.key != stop.room || distance(robot.here, goal(robot)) > 2 * ARRIVED) return;
        if (robot.since < 0.0) robot.since = tick.time;
        if (tick.time - robot.since < stop.service + (stop.claim == nullptr ? 0.0 : 1.0)) return;
        if (stop.claim != nullptr) command.events.push_back({stop.claim, static_cast<int>(i), stop.task, "", ""});
        robot.stops.pop_front();
        robot.since = -1.0;
        robot.waits_since = tick.time;
    }

    // Who has the key of a room, nullptr: nobody.
    const Robot* holder(int room) const {
        for (const Robot& robot : robots_)
            if (room >= 0 && robot.key == room && robot.on_floor) return &robot;
        return nullptr;
    }

    // Let robots leave for their next stops. Nobody overtakes one that has its key but no way.
    void set_out(const mrta::Tick& tick, mrta::Command& command) {
        std::vector<std::size_t> waiting;
        for (std::size_t i = 0; i < robots_.size(); ++i) {
            const Robot& robot = robots_[i];
            if (!robot.drives && robot.since < 0.0 && !robot.stops.empty() && robot.on_floor) waiting.push_back(i);
        }
        std::stable_sort(waiting.begin(), waiting.end(), [&](std::size_t a, std::size_t b) {
            return robots_[a].waits_since < robots_[b].waits_since;
        });
        bool may_ask = tick.tick % ASK_EVERY == 0;
        for (const std::size_t i : waiting) {
            Robot& robot = robots_[i];
            const int wanted = robot.stops.front().room;
            const Robot* other = holder(wanted);
            if (other != nullptr && other != &robot) {
                command.waits_for.emplace_back(static_cast<int>(i), other->name);
                if (must_step_out(robot)) robot.stops.push_front({-1, nullptr, 0.0, -1});
            } else if (may_ask) {
                may_ask = find_way(i);
                if (may_ask) begin_way(i, wanted, command);
            }
        }
    }

    void begin_way(std::size_t i, int room, mrta::Command& command) {
        robots_[i].drives = true;
        robots_[i].key = room;
        std::vector<double> told;
        for (const Point& point : robots_[i].way) told.insert(told.end(), {point.x, point.y});
        command.paths.emplace_back(static_cast<int>(i), told);
        if (room >= 0)
            command.events.push_back({"granted", static_cast<int>(i), -1, names_[static_cast<std::size_t>(room)], ""});
    }

    // Of robots that stand and want each other's rooms in a ring, the one latest in the list makes
    // room.
    bool must_step_out(const Robot& robot) const {
        const Robot* at = &robot;
        const Robot* last = &robot;
        for (int k = 0; k < longest_ring_; ++k) {
            if (at->drives || at->since >= 0.0 || at->stops.empty() || at->key < 0) return false;
            at = holder(at->stops.front().room);
            if (at == nullptr) return false;
            if (at == &robot) return last == &robot;
            last = std::max(last, at);
        }
        return false;
    }

    // A way around robots that stand, and clear of the ways of those that drive.
    bool find_way(std::size_t i) {
        Robot& robot = robots_[i];
        std::vector<double> standing;
        for (const Robot& other : robots_)
            if (&other != &robot && !other.drives && other.on_floor) standing.insert(standing.end(), {other.here.x, other.here.y});
        const Point to = goal(robot);
        const auto found = harness_.plan(robot.here.x, robot.here.y, to.x, to.y, standing);
        std::vector<Point> way;
        for (std::size_t k = 0; k + 1 < found.size(); k += 2) way.push_back({found[k], found[k + 1]});
        for (const Robot& other : robots_)
            if (&other != &robot && other.drives && other.on_floor)
                for (const Point& a : way)
                    for (const Point& b : other.way)
                        if (distance(a, b) < APART) return false;
        robot.way = way;
        return !way.empty();
    }

    // Turn towards a point ahead on the way; drive unless a person is in front.
    void drive(const mrta::Tick& tick, std::size_t i, mrta::Command& command) {
        Robot& robot = robots_[i];
        const auto near = std::min_element(robot.way.begin(), robot.way.end(), [&](const Point& a, const Point& b) {
            return distance(a, robot.here) < distance(b, robot.here);
        });
        robot.way.erase(robot.way.begin(), near);  // what lies behind it is free again
        auto aim = robot.way.begin();
        while (aim + 1 != robot.way.end() && distance(*aim, robot.here) < AHEAD) ++aim;
        const double left = distance(robot.way.back(), robot.here);
        if (left < ARRIVED) {
            robot.drives = false;
            command.paths.emplace_back(static_cast<int>(i), std::vector<double>{});
            return;
        }
        const double bearing = std::atan2(aim->y - robot.here.y, aim->x - robot.here.x);
        const double error = std::remainder(bearing - robot.yaw, 2 * M_PI);
        bool stands = std::abs(error) > 0.5;
        for (std::size_t h = 0; h + 1 < tick.human_position.size(); h += 2) {
            const double dx = tick.human_position[h] - robot.here.x, dy = tick.human_position[h + 1] - robot.here.y;
            const double forward = dx * std::cos(robot.yaw) + dy * std::sin(robot.yaw);
            stands |= forward > 0.0 && forward < IN_FRONT && std::abs(dy * std::cos(robot.yaw) - dx * std::sin(robot.yaw)) < ASIDE;
        }
        command.twist[3 * i] = stands ? 0.0 : std::min(SPEED, 1.5 * left + 0.05);
        command.twist[3 * i + 2] = std::clamp(2.0 * error, -TURNING, TURNING);
    }
};

int main() { return mrta::serve<RoomKeys>({"room keys", "1.0", {"deliveries", "goals", "paths"}}); }
