// Nodes of a user on eProsima's Fast DDS 2, without ROS: each message is read and written by
// Fast CDR, field by field. After each clock it answers with what it has seen, so that the other
// side can check every value, and acknowledges the clock.
//
// Arguments: domain, number of robots, "still" if all are to stand. It ends when nothing comes for 60 s.
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::types::ReturnCode_t;
using Bytes = std::vector<char>;

constexpr size_t most_bytes = 1 << 20;
constexpr auto silence = std::chrono::seconds(60);

// A type of which only the name is known here; its samples are serialised messages.
struct Serialised : fast::TopicDataType {
    explicit Serialised(const std::string& name)
    {
        setName(name.c_str());
        m_typeSize = 4096;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, rtps::SerializedPayload_t* payload) override
    {
        const auto& bytes = *static_cast<Bytes*>(data);
        payload->reserve(static_cast<uint32_t>(bytes.size()));
        std::copy(bytes.begin(), bytes.end(), payload->data);
        payload->length = static_cast<uint32_t>(bytes.size());
        payload->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(rtps::SerializedPayload_t* payload, void* data) override
    {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override
    {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

Bytes written(const std::function<void(Cdr&)>& fill)
{
    Bytes bytes(4096);
    FastBuffer buffer(bytes.data(), bytes.size());
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    fill(cdr);
    bytes.resize(cdr.getSerializedDataLength());
    return bytes;
}

void read(Bytes& bytes, const std::function<void(Cdr&)>& take)
{
    FastBuffer buffer(bytes.data(), bytes.size());
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.read_encapsulation();
    take(cdr);
}

struct Header {
    int32_t sec = 0;
    uint32_t nanosec = 0;
    std::string frame;
    void operator>>(Cdr& cdr) const { cdr << sec << nanosec << frame; }
    void operator<<(Cdr& cdr) { cdr >> sec >> nanosec >> frame; }
};

struct Robot {
    double x = 0.0, y = 0.0;
    float range = 0.0F;
};

struct Quality {
    bool reliable = true;
    bool transient_local = false;
};

class Node {
public:
    Node(int domain, int count, bool still) : robots(count), stands(still)
    {
        fast::DomainParticipantQos qos;
        qos.transport().use_builtin_transports = false;  // they would leave the machine
        auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
        udp->interfaceWhiteList.push_back("127.0.0.1");
        qos.transport().user_transports.push_back(udp);
        participant = fast::DomainParticipantFactory::get_instance()->create_participant(domain, qos);
        publisher = participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
        subscriber = participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
        for (int i = 0; i < count; ++i) {
            const std::string name = "/robot" + std::to_string(i + 1);
            for (const auto& [topic, type] :
                 {std::pair{"/cmd_vel", "geometry_msgs::msg::dds_::Twist_"},
                  std::pair{"/goal_pose", "geometry_msgs::msg::dds_::PoseStamped_"},
                  std::pair{"/plan", "nav_msgs::msg::dds_::Path_"}})
                advertise(name + topic, type);
            listen(name + "/odom", "nav_msgs::msg::dds_::Odometry_", {}, [this, i](Cdr& cdr) {
                Header header;
                header << cdr;
                std::string child;
                cdr >> child >> robots[i].x >> robots[i].y;
            });
            listen(name + "/scan", "sensor_msgs::msg::dds_::LaserScan_", {false, false},
                   [this, i](Cdr& cdr) {
                       Header header;
                       header << cdr;
                       float skipped = 0.0F;
                       for (int k = 0; k < 7; ++k) cdr >> skipped;
                       std::vector<float> ranges;
                       cdr >> ranges;
                       robots[i].range = ranges.at(1);
                   });
        }
        advertise("/events", "std_msgs::msg::dds_::String_");
        listen("/map", "nav_msgs::msg::dds_::OccupancyGrid_", {true, true}, [this](Cdr& cdr) {
            Header header;
            header << cdr;
            int32_t sec = 0;
            uint32_t nanosec = 0, width = 0, height = 0;
            float resolution = 0.0F;
            double number = 0.0;
            cdr >> sec >> nanosec >> resolution >> width >> height;
            for (int k = 0; k < 7; ++k) cdr >> number;
            std::vector<int8_t> cells;
            cdr >> cells;
            int sum = 0;
            for (const auto cell : cells) sum += cell;
            seen = header.frame + " " + std::to_string(width) + "x" + std::to_string(height) + " "
                + std::to_string(sum);
        });
        listen("/tf", "tf2_msgs::msg::dds_::TFMessage_", {}, [this](Cdr& cdr) {
            uint32_t count_of_transforms = 0;
            Header header;
            std::string child;
            cdr >> count_of_transforms;
            header << cdr;
            cdr >> child;
            frames = header.frame + " to " + child;
        });
        listen("/clock", "rosgraph_msgs::msg::dds_::Clock_", {}, [this](Cdr& cdr) {
            int32_t sec = 0;
            uint32_t nanosec = 0;
            cdr >> sec >> nanosec;
            clocks.push_back(uint64_t(sec) * 1000000000U + nanosec);
        });
        wait_for_subscribers();
        advertise("/clock_done", "std_msgs::msg::dds_::UInt64MultiArray_");  // ready to step
    }

    // Answer the next clock; false: none has come.
    bool answer()
    {
        std::unique_lock<std::mutex> guard(lock);
        if (!news.wait_for(guard, silence, [this] { return !clocks.empty(); })) return false;
        const uint64_t clock = clocks.front();
        clocks.pop_front();
        const Header now{int32_t(clock / 1000000000U), uint32_t(clock % 1000000000U), "map"};
        for (size_t i = 0; i < robots.size(); ++i) answer_for(i, now, double(clock) * 1e-9);
        publish("/events", [this](Cdr& cdr) {
            cdr << std::string("{\"kind\": \"seen\", \"detail\": \"" + seen + ", " + frames + "\"}");
        });
        publish("/clock_done", [&](Cdr& cdr) {
            cdr << uint32_t(0) << uint32_t(0) << std::vector<uint64_t>{clock, sent};
        });
        return true;
    }

private:
    void wait_for_subscribers() const
    {
        const auto until = std::chrono::steady_clock::now() + silence;
        for (const auto& [name, writer] : writers) {
            fast::PublicationMatchedStatus status;
            do {
                std::this_thread::sleep_for(std::chrono::milliseconds(10));
                writer->get_publication_matched_status(status);
            } while (status.current_count == 0 && std::chrono::steady_clock::now() < until);
        }
    }

    struct Listener : fast::DataReaderListener {
        Node* node = nullptr;
        std::function<void(Cdr&)> take;
        void on_data_available(fast::DataReader* reader) override
        {
            Bytes bytes;
            fast::SampleInfo info;
            const std::lock_guard<std::mutex> guard(node->lock);
            while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
                if (info.valid_data) read(bytes, take);
            node->news.notify_one();
        }
    };

    void answer_for(size_t i, const Header& now, double time)
    {
        const Robot& robot = robots[i];
        const std::string name = "/robot" + std::to_string(i + 1);
        publish(name + "/cmd_vel", [&](Cdr& cdr) {
            const double shares = stands ? 0.0 : 1.0;
            cdr << shares * robot.x << (stands ? 0.0 : double(robot.range));
            cdr << 0.0 << 0.0 << 0.0 << shares * time;
        });
        publish(name + "/goal_pose", [&](Cdr& cdr) {
            now >> cdr;
            cdr << robot.x + 1.0 << robot.y - 1.0 << 0.0 << 0.0 << 0.0 << 0.0 << 1.0;
        });
        publish(name + "/plan", [&](Cdr& cdr) {
            now >> cdr;
            cdr << uint32_t(2);
            for (const double ahead : {0.5, 1.0}) {
                now >> cdr;
                cdr << robot.x + ahead << robot.y << 0.0 << 0.0 << 0.0 << 0.0 << 1.0;
            }
        });
    }

    void publish(const std::string& topic, const std::function<void(Cdr&)>& fill)
    {
        Bytes bytes = written(fill);
        writers.at(topic)->write(&bytes);
        if (topic != "/clock_done") ++sent;
    }

    fast::Topic* topic_of(const std::string& name, const std::string& type)
    {
        fast::TypeSupport support(new Serialised(type));
        support.register_type(participant);
        return participant->create_topic("rt" + name, type, fast::TOPIC_QOS_DEFAULT);
    }

    template <typename Qos>
    static void describe(Qos& qos, const Quality& quality)
    {
        qos.reliability().kind = quality.reliable ? fast::RELIABLE_RELIABILITY_QOS
                                                  : fast::BEST_EFFORT_RELIABILITY_QOS;
        qos.durability().kind = quality.transient_local ? fast::TRANSIENT_LOCAL_DURABILITY_QOS
                                                        : fast::VOLATILE_DURABILITY_QOS;
        qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
        qos.history().depth = 10;
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    }

    void advertise(const std::string& name, const std::string& type)
    {
        fast::DataWriterQos qos = fast::DATAWRITER_QOS_DEFAULT;
        describe(qos, {});
        writers[name] = publisher->create_datawriter(topic_of(name, type), qos);
    }

    void listen(const std::string& name, const std::string& type, const Quality& quality,
                std::function<void(Cdr&)> take)
    {
        fast::DataReaderQos qos = fast::DATAREADER_QOS_DEFAULT;
        describe(qos, quality);
        listeners.push_back(std::make_unique<Listener>());
        listeners.back()->node = this;
        listeners.back()->take = std::move(take);
        subscriber->create_datareader(topic_of(name, type), qos, listeners.back().get());
    }

    std::vector<Robot> robots;
    bool stands;
    std::string seen, frames;
    std::deque<uint64_t> clocks;
    uint64_t sent = 0;
    std::mutex lock;
    std::condition_variable news;
    std::map<std::string, fast::DataWriter*> writers;
    std::vector<std::unique_ptr<Listener>> listeners;
    fast::DomainParticipant* participant = nullptr;
    fast::Publisher* publisher = nullptr;
    fast::Subscriber* subscriber = nullptr;
};

int main(int count, char** arguments)
{
    Node node(std::atoi(arguments[1]), std::atoi(arguments[2]), count > 3);
    while (node.answer()) {
    }
    std::_Exit(0);  // nobody is left to say goodbye to
}
