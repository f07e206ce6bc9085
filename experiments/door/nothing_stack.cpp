// A stack that does nothing; what it takes is the door's.
#include "mrta_stack.hpp"

struct Nothing {
    std::size_t robots;
    Nothing(const mrta::Value& world, mrta::Harness&) : robots(world["robots"].size()) {}

    mrta::Command step(const mrta::Tick&) {
        mrta::Command command;
        command.twist.assign(3 * robots, 0.0);
        return command;
    }
};

int main() { return mrta::serve<Nothing>({"nothing", "1", {}}); }
