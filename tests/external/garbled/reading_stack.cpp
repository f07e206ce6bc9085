// A stack that reads all it is told, and asks a question a tick; a fuzzed harness speaks to it.
#include <cmath>

#include "mrta_stack.hpp"

struct Reading {
    mrta::Harness& harness;
    std::size_t robots;
    Reading(const mrta::Value& world, mrta::Harness& h) : harness(h), robots(world["robots"].size()) {}

    mrta::Command step(const mrta::Tick& tick) {
        double sum = 0.0;
        for (std::size_t i = 0; i < robots; ++i) sum += tick.pose[3 * i + 2] + tick.velocity[3 * i + 2];
        for (std::size_t i = 0; i + 1 < tick.human_position.size(); i += 2)
            sum += tick.human_position[i + 1] + tick.human_velocity[i + 1];
        const std::size_t rays = robots == 0 ? 0 : tick.obstacle_points.size() / 2 / robots;
        for (std::size_t i = 0; i < robots * rays; ++i) sum += tick.obstacle_points[2 * i + 1];
        for (const mrta::Task& task : tick.tasks) sum += task.deadline + task.start + task.end;
        for (const mrta::Value& claim : tick.refused.list) sum += claim["robot"].integer();
        const auto path = harness.plan(tick.pose.at(0), tick.pose.at(1), 1.0, 1.0);
        mrta::Command command;
        command.twist.assign(3 * robots, 0.0);
        if (robots > 0 && sum > static_cast<double>(path.size())) command.twist[0] = 0.1;
        return command;
    }
};

int main() { return mrta::serve<Reading>({"reads", "1", {"goals"}}); }
