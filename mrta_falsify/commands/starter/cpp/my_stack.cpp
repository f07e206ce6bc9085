// A stack to begin with: one robot drives at a time, the others stand at their parking spots.
//
// Build it by: c++ -std=c++17 -O2 -o my_stack my_stack.cpp
// Run it by: mrta-falsify campaign my_scenario.scenic --stack stack.yaml -o runs/first
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "mrta_stack.hpp"

constexpr double SPEED = 0.5;    // m/s
constexpr double AHEAD = 0.4;    // m; how far along its path a robot aims
constexpr double ARRIVED = 0.2;  // m
constexpr double KEEP = 0.7;     // m; a robot stops for people and robots nearer than this

using Point = std::pair<double, double>;

struct Stop {
    Point point;
    const char* claim;  // once it is done, nullptr: nothing
    double service;     // s
    int task;
};

// Asked once a tick; everything it may know is in `world` and `tick`.
class MyStack {
public:
    MyStack(const mrta::Value& world, mrta::Harness& harness)
        : harness_(harness), robots_(world["robots"].size()) {
        for (const mrta::Value& room : world["rooms"].list) {
            const auto point = room["point"].numbers(2);
            rooms_.emplace_back(point[0], point[1]);
        }
        for (const mrta::Value& spot : world["parking"].list) {
            const auto point = spot.numbers(2);
            if (spots_.size() < robots_) spots_.emplace_back(point[0], point[1]);
        }
    }

    mrta::Command step(const mrta::Tick& tick) {
        mrta::Command command;
        command.twist.assign(3 * robots_, 0.0);
        command.goal.assign(2 * robots_, std::numeric_limits<double>::quiet_NaN());
        command.stops_left.assign(robots_, 0);
        tasks_.insert(tasks_.end(), tick.tasks.begin(), tick.tasks.end());
        std::stable_sort(tasks_.begin(), tasks_.end(), [](const mrta::Task& a, const mrta::Task& b) {
            return a.deadline < b.deadline;
        });
        if (stops_.empty()) begin(tick);
        if (!stops_.empty()) work(tick, command);
        return command;
    }

private:
    mrta::Harness& harness_;
    std::size_t robots_;
    std::vector<Point> rooms_, spots_;
    std::deque<mrta::Task> tasks_;  // that nobody has begun, the most urgent first
    std::size_t busy_ = 0;          // the robot that drives
    std::deque<Stop> stops_;        // of its
    std::vector<double> path_;      // of its
    double since_ = -1.0;           // when it arrived at the stop [s]

    static double away(const mrta::Tick& tick, std::size_t robot, const Point& point) {
        return std::hypot(tick.pose[3 * robot] - point.first, tick.pose[3 * robot + 1] - point.second);
    }

    // Send home who is not at its spot; then take the most urgent task.
    void begin(const mrta::Tick& tick) {
        path_.clear();
        for (std::size_t i = 0; i < spots_.size(); ++i) {
            if (away(tick, i, spots_[i]) > 2 * ARRIVED) {
                busy_ = i;
                stops_ = {{spots_[i], nullptr, 0.0, -1}};
                return;
            }
        }
        if (tasks_.empty()) return;
        const mrta::Task task = tasks_.front();
        tasks_.pop_front();
        const Point start = rooms_.at(static_cast<std::size_t>(task.start));
        busy_ = 0;
        for (std::size_t i = 1; i < robots_; ++i)
            if (away(tick, i, start) < away(tick, busy_, start)) busy_ = i;
        stops_ = {{start, "picked-up", task.pickup_time, task.task},
                  {rooms_.at(static_cast<std::size_t>(task.end)), "dropped-off", task.dropoff_time, task.task}};
    }

    void work(const mrta::Tick& tick, mrta::Command& command) {
        const Stop stop = stops_.front();
        const Point goal = stop.point;
        command.goal[2 * busy_] = goal.first;
        command.goal[2 * busy_ + 1] = goal.second;
        command.stops_left[busy_] = static_cast<int>(stops_.size());
        if (away(tick, busy_, goal) > ARRIVED) {
            since_ = -1.0;
            if (path_.empty() || tick.tick % 40 == 0) {
                plan(tick, goal);
                command.paths.emplace_back(static_cast<int>(busy_), path_);
            }
            drive(tick, command);
        } else if (since_ < 0.0) {
            since_ = tick.time;
        } else if (tick.time - since_ > stop.service + 1.0) {  // it has come to rest, and stood
            if (stop.claim != nullptr)
                command.events.push_back({stop.claim, static_cast<int>(busy_), stop.task, "", ""});
            stops_.pop_front();
            path_.clear();
            since_ = -1.0;
        }
    }

    // The harness's planner, around the other robots, which stand.
    void plan(const mrta::Tick& tick, const Point& goal) {
        std::vector<double> others;
        for (std::size_t i = 0; i < robots_; ++i) {
            if (i == busy_) continue;
            others.push_back(tick.pose[3 * i]);
            others.push_back(tick.pose[3 * i + 1]);
        }
        const double x = tick.pose[3 * busy_], y = tick.pose[3 * busy_ + 1];
        path_ = harness_.plan(x, y, goal.first, goal.second, others);
        if (path_.empty()) path_ = harness_.plan(x, y, goal.first, goal.second);
    }

    // Turn towards a point ahead on the path; drive if nothing is in the way.
    void drive(const mrta::Tick& tick, mrta::Command& command) const {
        if (path_.empty()) return;
        const double x = tick.pose[3 * busy_], y = tick.pose[3 * busy_ + 1], yaw = tick.pose[3 * busy_ + 2];
        const std::size_t points = path_.size() / 2;
        const auto to = [&](std::size_t k) { return std::hypot(path_[2 * k] - x, path_[2 * k + 1] - y); };
        std::size_t ahead = 0;
        for (std::size_t k = 1; k < points; ++k)
            if (to(k) < to(ahead)) ahead = k;
        while (ahead + 1 < points && to(ahead) < AHEAD) ++ahead;
        double error = std::atan2(path_[2 * ahead + 1] - y, path_[2 * ahead] - x) - yaw;
        error = std::atan2(std::sin(error), std::cos(error));
        const auto blocks = [&](double px, double py) {
            const double dx = px - x, dy = py - y;
            const double forward = dx * std::cos(yaw) + dy * std::sin(yaw);
            const double aside = std::abs(-dx * std::sin(yaw) + dy * std::cos(yaw));
            return forward > 0.0 && forward < KEEP + 0.3 && aside < 0.6;
        };
        bool blocked = false;
        for (std::size_t i = 0; i < tick.human_position.size(); i += 2)
            blocked |= blocks(tick.human_position[i], tick.human_position[i + 1]);
        for (std::size_t i = 0; i < robots_; ++i)
            blocked |= i != busy_ && blocks(tick.pose[3 * i], tick.pose[3 * i + 1]);
        const bool stands = blocked || std::abs(error) > 0.5;
        command.twist[3 * busy_] = stands ? 0.0 : std::min(SPEED, 1.5 * to(points - 1) + 0.05);
        command.twist[3 * busy_ + 2] = std::clamp(2.0 * error, -1.5, 1.5);
    }
};

int main() { return mrta::serve<MyStack>({"my stack", "0.1", {"deliveries", "goals", "paths"}}); }
