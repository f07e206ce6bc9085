// Put your own stack on trial: copy this file beside it. C++17, the standard library, POSIX.
//
//     #include "mrta_stack.hpp"
//
//     struct MyStack {
//         std::size_t robots;
//         MyStack(const mrta::Value& world, mrta::Harness&) : robots(world["robots"].size()) {}
//         mrta::Command step(const mrta::Tick&) {
//             mrta::Command command;
//             command.twist.assign(3 * robots, 0.0);  // forward, left [m/s], turn rate [rad/s]
//             return command;
//         }
//     };
//
//     int main() { return mrta::serve<MyStack>({"my stack", "1.0", {"deliveries", "goals"}}); }
//
// The harness starts this program once per episode, with a socket in the environment variable
// MRTA_STACK_FD. Simulated time stands while `step` works. All numbers are in metres, radians and
// seconds in the map frame (REP-103); arrays are flat, in C order. docs/door.md of mrta-falsify has
// every message and field.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace mrta {

constexpr int protocol_major = 1;
constexpr int protocol_minor = 0;
constexpr std::uint32_t most_bytes = 64u << 20;  // of one message

// --- values of messages ---------------------------------------------------------------------

// A value of a message: nothing, a truth value, a number, text, bytes, a list or a map.
class Value {
public:
    enum class Kind { nothing, truth, whole, real, text, bytes, list, map };

    Kind kind = Kind::nothing;
    std::int64_t whole = 0;
    double real = 0.0;
    std::string text;  // of text and bytes
    std::vector<Value> list;
    std::map<std::string, Value> map;

    // A member of a map; throws std::out_of_range if there is none.
    const Value& operator[](const std::string& name) const {
        const auto found = map.find(name);
        if (found == map.end()) throw std::out_of_range("no field " + name);
        return found->second;
    }
    const Value& operator[](const char* name) const { return (*this)[std::string(name)]; }
    const Value& operator[](std::size_t i) const { return list.at(i); }
    bool has(const std::string& name) const { return map.count(name) > 0; }
    std::size_t size() const { return kind == Kind::map ? map.size() : list.size(); }

    double number() const {
        if (kind != Kind::real && kind != Kind::whole) throw std::runtime_error("a field is no number");
        return kind == Kind::real ? real : static_cast<double>(whole);
    }
    int integer() const {
        const double value = number();
        if (!(std::abs(value) <= std::numeric_limits<int>::max())) throw std::runtime_error("a number is too large");
        return static_cast<int>(value);
    }
    bool truth() const {
        if (kind != Kind::truth) throw std::runtime_error("a field is no truth value");
        return whole != 0;
    }

    // Numbers: of bytes (float64), or of a list, lists in it laid end to end.
    std::vector<double> numbers() const {
        std::vector<double> found;
        if (kind == Kind::bytes) {
            if (text.size() % sizeof(double) != 0) throw std::runtime_error("an array is cut short");
            found.resize(text.size() / sizeof(double));
            if (!found.empty()) std::memcpy(found.data(), text.data(), text.size());
        } else {
            flatten(found);
        }
        return found;
    }
    // The same; throws if there are not `count`.
    std::vector<double> numbers(std::size_t count) const {
        std::vector<double> found = numbers();
        if (found.size() != count) throw std::runtime_error("an array has another shape than docs/door.md says");
        return found;
    }

private:
    void flatten(std::vector<double>& into) const {
        if (kind == Kind::list) {
            for (const Value& item : list) item.flatten(into);
        } else if (kind == Kind::nothing) {
            into.push_back(std::numeric_limits<double>::quiet_NaN());
        } else {
            into.push_back(number());
        }
    }
};

// --- msgpack --------------------------------------------------------------------------------

class Unpacker {
public:
    Unpacker(const char* data, std::size_t size) : at_(data), end_(data + size) {}

    Value value(int depth = 0) {
        if (depth > 64) throw std::runtime_error("a message is nested too deeply");
        Value v;
        const auto tag = static_cast<std::uint8_t>(*take(1));
        if (tag <= 0x7f || tag >= 0xe0) return whole(static_cast<std::int8_t>(tag));
        if (tag <= 0x8f) return map(tag & 0x0f, depth);
        if (tag <= 0x9f) return list(tag & 0x0f, depth);
        if (tag <= 0xbf) return text(tag & 0x1f, Value::Kind::text);
        switch (tag) {
            case 0xc0: return v;
            case 0xc2: case 0xc3:
                v.kind = Value::Kind::truth;
                v.whole = tag == 0xc3;
                return v;
            case 0xc4: return text(big(1), Value::Kind::bytes);
            case 0xc5: return text(big(2), Value::Kind::bytes);
            case 0xc6: return text(big(4), Value::Kind::bytes);
            case 0xca: {
                const auto bits = static_cast<std::uint32_t>(big(4));
                float number;
                std::memcpy(&number, &bits, sizeof number);
                v.kind = Value::Kind::real;
                v.real = number;
                return v;
            }
            case 0xcb: {
                const std::uint64_t bits = big(8);
                v.kind = Value::Kind::real;
                std::memcpy(&v.real, &bits, sizeof v.real);
                return v;
            }
            case 0xcc: return whole(static_cast<std::int64_t>(big(1)));
            case 0xcd: return whole(static_cast<std::int64_t>(big(2)));
            case 0xce: return whole(static_cast<std::int64_t>(big(4)));
            case 0xcf: return whole(static_cast<std::int64_t>(big(8)));
            case 0xd0: return whole(static_cast<std::int8_t>(big(1)));
            case 0xd1: return whole(static_cast<std::int16_t>(big(2)));
            case 0xd2: return whole(static_cast<std::int32_t>(big(4)));
            case 0xd3: return whole(static_cast<std::int64_t>(big(8)));
            case 0xd9: return text(big(1), Value::Kind::text);
            case 0xda: return text(big(2), Value::Kind::text);
            case 0xdb: return text(big(4), Value::Kind::text);
            case 0xdc: return list(big(2), depth);
            case 0xdd: return list(big(4), depth);
            case 0xde: return map(big(2), depth);
            case 0xdf: return map(big(4), depth);
            default: throw std::runtime_error("a message is not msgpack");
        }
    }

private:
    const char* at_;
    const char* end_;

    const char* take(std::size_t size) {
        if (size > static_cast<std::size_t>(end_ - at_)) throw std::runtime_error("a message is cut short");
        const char* here = at_;
        at_ += size;
        return here;
    }
    std::uint64_t big(int size) {
        std::uint64_t number = 0;
        const char* bytes = take(static_cast<std::size_t>(size));
        for (int i = 0; i < size; ++i) number = number << 8 | static_cast<std::uint8_t>(bytes[i]);
        return number;
    }
    static Value whole(std::int64_t number) {
        Value v;
        v.kind = Value::Kind::whole;
        v.whole = number;
        return v;
    }
    Value text(std::uint64_t size, Value::Kind kind) {
        Value v;
        v.kind = kind;
        v.text.assign(take(size), size);
        return v;
    }
    Value list(std::uint64_t size, int depth) {
        Value v;
        v.kind = Value::Kind::list;
        for (std::uint64_t i = 0; i < size; ++i) v.list.push_back(value(depth + 1));
        return v;
    }
    Value map(std::uint64_t size, int depth) {
        Value v;
        v.kind = Value::Kind::map;
        for (std::uint64_t i = 0; i < size; ++i) {
            Value name = value(depth + 1);
            v.map[name.text] = value(depth + 1);
        }
        return v;
    }
};

class Packer {
public:
    std::string bytes;

    void map(std::size_t size) { header(size, 0x80, 0xdf); }
    void list(std::size_t size) { header(size, 0x90, 0xdd); }
    void text(const std::string& text) {
        bytes.push_back(static_cast<char>(0xdb));
        big(text.size(), 4);
        bytes += text;
    }
    void whole(std::int64_t number) {
        bytes.push_back(static_cast<char>(0xd3));
        big(static_cast<std::uint64_t>(number), 8);
    }
    void real(double number) {
        std::uint64_t bits;
        std::memcpy(&bits, &number, sizeof bits);
        bytes.push_back(static_cast<char>(0xcb));
        big(bits, 8);
    }
    void array(const std::vector<double>& numbers) {
        const std::size_t size = numbers.size() * sizeof(double);
        bytes.push_back(static_cast<char>(0xc6));
        big(size, 4);
        bytes.append(reinterpret_cast<const char*>(numbers.data()), size);
    }

private:
    void header(std::size_t size, int small, int large) {
        if (size < 16) {
            bytes.push_back(static_cast<char>(small | static_cast<int>(size)));
        } else {
            bytes.push_back(static_cast<char>(large));
            big(size, 4);
        }
    }
    void big(std::uint64_t number, int size) {
        for (int i = size - 1; i >= 0; --i) bytes.push_back(static_cast<char>(number >> (8 * i)));
    }
};

// --- the connection -------------------------------------------------------------------------

struct Closed : std::runtime_error {
    Closed() : std::runtime_error("the harness has closed the connection") {}
};

// Messages over a stream socket: a length (u32, little-endian), then that many bytes.
class Connection {
public:
    explicit Connection(int number) : number_(number) {}

    void send(const std::string& body) {
        const auto size = static_cast<std::uint32_t>(body.size());
        std::string whole(4, '\0');
        for (int i = 0; i < 4; ++i) whole[static_cast<std::size_t>(i)] = static_cast<char>(size >> (8 * i));
        whole += body;
        for (std::size_t sent = 0; sent < whole.size();) {
            const ssize_t n = ::send(number_, whole.data() + sent, whole.size() - sent, MSG_NOSIGNAL);
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) throw Closed();
            sent += static_cast<std::size_t>(n);
        }
    }

    std::string receive() {
        fill(4);
        std::uint32_t size = 0;
        for (int i = 3; i >= 0; --i) size = size << 8 | static_cast<std::uint8_t>(rest_[static_cast<std::size_t>(i)]);
        if (size > most_bytes) throw std::runtime_error("too long a message is announced");
        fill(4 + static_cast<std::size_t>(size));
        std::string body = rest_.substr(4, size);
        rest_.erase(0, 4 + static_cast<std::size_t>(size));
        return body;
    }

    Value ask(const Packer& question) {
        send(question.bytes);
        const std::string body = receive();
        return Unpacker(body.data(), body.size()).value();
    }

    // Go on over another socket.
    void move_to(int number) {
        ::close(number_);
        number_ = number;
        rest_.clear();
    }

private:
    int number_;
    std::string rest_;

    void fill(std::size_t size) {
        char part[1 << 16];
        while (rest_.size() < size) {
            const ssize_t n = ::recv(number_, part, sizeof part, 0);
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) throw Closed();
            rest_.append(part, static_cast<std::size_t>(n));
        }
    }
};

// --- what a stack sees and says -------------------------------------------------------------

struct Task {
    int task, start, end;  // number of the task, rooms
    double deadline, pickup_time, dropoff_time;  // [s]
    std::string robot;  // the only one that may serve it, empty: any
};

struct Tick {
    int tick = 0;
    double time = 0.0;  // [s]
    std::vector<double> pose;  // N x 3, as localised
    std::vector<double> velocity;  // N x 3 forward, left [m/s], turn rate [rad/s]
    std::vector<double> human_position;  // H x 2, inf: not there
    std::vector<double> human_velocity;  // H x 2
    std::vector<double> obstacle_points;  // N x A x 2, inf: none
    std::vector<Task> tasks;  // that have just arrived
    Value refused;  // claims of the last tick that do not count, and why
    bool closed = false;  // no task will arrive any more
};

struct Event {
    std::string kind;  // "picked-up" and "dropped-off" are claims; see docs/world.md for others
    int robot = -1, task = -1;
    std::string resource, detail;
};

struct Command {
    std::vector<double> twist;  // N x 3 forward, left [m/s], turn rate [rad/s]; empty: not said
    std::vector<int> follow;  // robots that the harness is to drive to their goals
    std::vector<double> goal;  // N x 2, nan: none; empty: not said
    std::vector<int> stops_left;  // N; empty: not said
    std::vector<std::pair<int, std::vector<double>>> paths;  // robot, L x 2; those that changed
    std::vector<std::pair<int, std::string>> waits_for;  // robot, whom or what it waits for
    std::vector<Event> events;
};

// What a stack may ask in the middle of a tick; simulated time stands meanwhile.
class Harness {
public:
    explicit Harness(Connection& connection) : connection_(connection) {}

    // A path L x 2 [m] between two points; empty: there is none. `avoid`: places P x 2 [m] at which
    // robots stand.
    std::vector<double> plan(double x0, double y0, double x1, double y1,
                             const std::vector<double>& avoid = {}) {
        return ask("plan", x0, y0, x1, y1, avoid)["points"].numbers();
    }
    // The time [s] that a robot needs between two points; inf: there is no way.
    double travel_time(double x0, double y0, double x1, double y1) {
        return ask("travel_time", x0, y0, x1, y1)["seconds"].number();
    }
    // Whether no wall or furniture stands between two points.
    bool visible(double x0, double y0, double x1, double y1) {
        return ask("visible", x0, y0, x1, y1)["visible"].truth();
    }

private:
    Connection& connection_;

    Value ask(const char* type, double x0, double y0, double x1, double y1,
              const std::vector<double>& avoid = {}) {
        Packer question;
        question.map(4);
        question.text("type");
        question.text(type);
        question.text("start");
        question.list(2);
        question.real(x0);
        question.real(y0);
        question.text("goal");
        question.list(2);
        question.real(x1);
        question.real(y1);
        question.text("avoid");
        question.list(avoid.size() / 2);
        for (std::size_t i = 0; i + 1 < avoid.size(); i += 2) {
            question.list(2);
            question.real(avoid[i]);
            question.real(avoid[i + 1]);
        }
        return connection_.ask(question);
    }
};

struct About {
    std::string name;
    std::string version;
    std::vector<std::string> says;  // "deliveries", "goals", "paths"
    bool can_branch = true;  // the process may be copied by fork, which threads do not survive
};

// --- the loop -------------------------------------------------------------------------------

inline std::string ready(const About& about) {
    const auto quoted = [](const std::string& text) {
        std::string made = "\"";
        for (const char c : text) {
            if (c == '"' || c == '\\') made += '\\';
            made += c;
        }
        return made + '"';
    };
    std::string says;
    for (const std::string& name : about.says) says += (says.empty() ? "" : ",") + quoted(name);
    return "{\"type\":\"ready\",\"protocol\":[" + std::to_string(protocol_major) + ","
        + std::to_string(protocol_minor) + "],\"encoding\":\"msgpack\",\"name\":" + quoted(about.name)
        + ",\"version\":" + quoted(about.version) + ",\"says\":[" + says + "],\"can\":["
        + (about.can_branch ? "\"branch\"" : "") + "]}";
}

inline Tick tick_of(const Value& message, std::size_t robots, std::size_t people) {
    Tick tick;
    tick.tick = message["tick"].integer();
    tick.time = message["time"].number();
    tick.pose = message["pose"].numbers(3 * robots);
    tick.velocity = message["velocity"].numbers(3 * robots);
    tick.human_position = message["human_position"].numbers(2 * people);
    tick.human_velocity = message["human_velocity"].numbers(2 * people);
    tick.obstacle_points = message["obstacle_points"].numbers();
    if (robots == 0 ? !tick.obstacle_points.empty() : tick.obstacle_points.size() % (2 * robots) != 0)
        throw std::runtime_error("an array has another shape than docs/door.md says");
    for (const Value& task : message["tasks"].list) {
        tick.tasks.push_back({task["task"].integer(), task["start"].integer(), task["end"].integer(),
                              task["deadline"].number(), task["pickup_time"].number(),
                              task["dropoff_time"].number(), task["robot"].text});
    }
    tick.refused = message["refused"];
    tick.closed = message["closed"].truth();
    return tick;
}

inline std::string packed(const Command& command, int tick) {
    Packer made;
    made.map(4 + !command.twist.empty() + !command.goal.empty() + !command.stops_left.empty()
             + !command.paths.empty() + !command.events.empty());
    made.text("type");
    made.text("command");
    made.text("tick");
    made.whole(tick);
    made.text("follow");
    made.list(command.follow.size());
    for (const int robot : command.follow) made.whole(robot);
    if (!command.twist.empty()) {
        made.text("twist");
        made.array(command.twist);
    }
    if (!command.goal.empty()) {
        made.text("goal");
        made.array(command.goal);
    }
    if (!command.stops_left.empty()) {
        made.text("stops_left");
        made.list(command.stops_left.size());
        for (const int left : command.stops_left) made.whole(left);
    }
    if (!command.paths.empty()) {
        made.text("paths");
        made.list(command.paths.size());
        for (const auto& [robot, points] : command.paths) {
            made.list(2);
            made.whole(robot);
            made.array(points);
        }
    }
    made.text("waits_for");
    made.list(command.waits_for.size());
    for (const auto& [robot, what] : command.waits_for) {
        made.list(2);
        made.whole(robot);
        made.text(what);
    }
    if (!command.events.empty()) {
        made.text("events");
        made.list(command.events.size());
        for (const Event& event : command.events) {
            made.map(5);
            made.text("kind");
            made.text(event.kind);
            made.text("robot");
            made.whole(event.robot);
            made.text("task");
            made.whole(event.task);
            made.text("resource");
            made.text(event.resource);
            made.text("detail");
            made.text(event.detail);
        }
    }
    return made.bytes;
}

// Go on in a copy of this process, on a socket of its own; the original waits for more.
inline void branch(Connection& connection, const std::string& address) {
    std::fflush(nullptr);
    const pid_t child = ::fork();
    if (child > 0) {
        ::waitpid(child, nullptr, 0);
        Packer answer;
        answer.map(1);
        answer.text("type");
        answer.text("branched");
        connection.send(answer.bytes);
        return;
    }
    if (child < 0 || ::fork() > 0) ::_exit(0);  // nobody has to wait for the copy
    const int link = ::socket(AF_UNIX, SOCK_STREAM, 0);
    sockaddr_un there{};
    there.sun_family = AF_UNIX;
    std::strncpy(there.sun_path, address.c_str(), sizeof there.sun_path - 1);
    if (::connect(link, reinterpret_cast<const sockaddr*>(&there), sizeof there) != 0) ::_exit(1);
    connection.move_to(link);
}

// Answer the harness until it says bye; gives the exit code of the program.
template <class Stack>
int serve(const About& about) {
    const char* number = std::getenv("MRTA_STACK_FD");
    if (number == nullptr) {
        std::fprintf(stderr, "this program is a stack for mrta-falsify: run it by --stack 'exec:...'\n");
        return 2;
    }
    Connection connection(std::atoi(number));
    Harness harness(connection);
    std::unique_ptr<Stack> stack;
    std::size_t robots = 0, people = 0;
    try {
        while (true) {
            const std::string body = connection.receive();
            if (!body.empty() && body[0] == '{') {  // the handshake is JSON; none of it needs to be read
                connection.send(ready(about));
                continue;
            }
            const Value message = Unpacker(body.data(), body.size()).value();
            const std::string& type = message["type"].text;
            if (type == "tick" && stack != nullptr) {
                const Tick tick = tick_of(message, robots, people);
                connection.send(packed(stack->step(tick), tick.tick));
            } else if (type == "world") {
                robots = message["robots"].size();
                people = message["humans"].size();
                stack = std::make_unique<Stack>(message, harness);
                Packer answer;
                answer.map(1);
                answer.text("type");
                answer.text("ready");
                connection.send(answer.bytes);
            } else if (type == "branch") {
                branch(connection, message["address"].text);
            } else if (type == "bye") {
                return 0;
            } else {
                throw std::runtime_error("a message of a type that is not known here");
            }
        }
    } catch (const Closed&) {
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "mrta_stack: %s\n", error.what());
        return 1;
    }
}

}  // namespace mrta
