// Robots that drive along one lane to the rooms of their tasks, and stop for whoever is ahead.
// lane_stack.py is the same in Python.
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "mrta_stack.hpp"

constexpr double SPEED = 0.5;    // m/s
constexpr double GAIN = 0.8;     // 1/s
constexpr double ARRIVED = 0.2;  // m
constexpr double KEEP = 1.0;     // m between centres
constexpr double STANDS = 2.0;   // s at a room until its stop is claimed
constexpr double HALF_TURN = 3.141592653589793;

struct Stop {
    double x;
    const char* kind;
    int task;
};

class Lane {
public:
    Lane(const mrta::Value& world, mrta::Harness&) {
        for (const mrta::Value& room : world["rooms"].list) rooms_.push_back(room["point"].numbers(2)[0]);
        for (const mrta::Value& robot : world["robots"].list) names_.push_back(robot["name"].text);
        stops_.resize(names_.size());
        since_.assign(names_.size(), -1.0);
    }

    mrta::Command step(const mrta::Tick& tick) {
        for (const mrta::Task& task : tick.tasks) {
            const auto robot = std::find(names_.begin(), names_.end(), task.robot) - names_.begin();
            auto& stops = stops_.at(static_cast<std::size_t>(robot));
            stops.push_back({rooms_.at(static_cast<std::size_t>(task.start)), "picked-up", task.task});
            stops.push_back({rooms_.at(static_cast<std::size_t>(task.end)), "dropped-off", task.task});
        }
        mrta::Command command;
        command.twist.assign(3 * names_.size(), 0.0);
        command.goal.assign(2 * names_.size(), std::numeric_limits<double>::quiet_NaN());
        for (std::size_t i = 0; i < names_.size(); ++i) {
            if (!stops_[i].empty()) work(i, tick, command);
            if (!stops_[i].empty()) {
                command.goal[2 * i] = stops_[i].front().x;
                command.goal[2 * i + 1] = tick.pose[3 * i + 1];
            }
            command.stops_left.push_back(static_cast<int>(stops_[i].size()));
        }
        return command;
    }

private:
    std::vector<double> rooms_;
    std::vector<std::string> names_;
    std::vector<std::deque<Stop>> stops_;  // of each robot
    std::vector<double> since_;            // it is at its stop

    void work(std::size_t i, const mrta::Tick& tick, mrta::Command& command) {
        const double x = tick.pose[3 * i], yaw = tick.pose[3 * i + 2];
        const Stop stop = stops_[i].front();
        const double away = stop.x - x;
        if (-ARRIVED < away && away < ARRIVED) {
            if (since_[i] < 0.0) {
                since_[i] = tick.time;
            } else if (tick.time - since_[i] > STANDS) {
                command.events.push_back({stop.kind, static_cast<int>(i), stop.task, "", ""});
                stops_[i].pop_front();
                since_[i] = -1.0;
            }
            return;
        }
        for (std::size_t j = 0; j < names_.size(); ++j) {
            const double gap = tick.pose[3 * j] - x;
            if (j != i && (away > 0.0 ? 0.0 < gap && gap < KEEP : -KEEP < gap && gap < 0.0)) {
                command.waits_for.emplace_back(static_cast<int>(i), names_[j]);
                return;
            }
        }
        const double speed = std::clamp(GAIN * away, -SPEED, SPEED);
        command.twist[3 * i] = std::abs(yaw) < 0.5 * HALF_TURN ? speed : -speed;
    }
};

int main() { return mrta::serve<Lane>({"lane", "", {"deliveries", "goals"}}); }
