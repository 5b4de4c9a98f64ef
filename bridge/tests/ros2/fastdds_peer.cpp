// A foreign subscriber to every topic with eProsima Fast DDS, the middleware of a stock ROS 2.
//
// In: the domain as argument; lines `topic type reliable latched` on standard input. Out: a line `ready`, then a line
// `topic type hex` for every sample: the serialised message as it came, encapsulation header included.

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <regex>
#include <string>
#include <thread>
#include <vector>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Bytes = std::vector<unsigned char>;

// Any type: its bytes are kept as they are.
class AnyType : public TopicDataType {
public:
    explicit AnyType(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 1024; // Only where memory starts; it grows with the sample.
    }
    bool serialize(void*, SerializedPayload_t*) override { return false; }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void*) override {
        return [] { return 0u; };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

struct Reader {
    std::string topic, type;
    DataReader* reader;
};

// As ROS names it in DDS: `nav_msgs/msg/OccupancyGrid` is `nav_msgs::msg::dds_::OccupancyGrid_`.
std::string dds_type(const std::string& type) {
    const auto cut = type.rfind('/');
    return std::regex_replace(type.substr(0, cut), std::regex("/"), "::") + "::dds_::" + type.substr(cut + 1) + "_";
}

DomainParticipant* on_loopback(int domain) {
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList = {"127.0.0.1"};
    DomainParticipantQos qos;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

void print(const Reader& reader, const Bytes& bytes) {
    static const char* digits = "0123456789abcdef";
    std::string line = reader.topic + " " + reader.type + " ";
    for (const auto byte : bytes) {
        line += digits[byte >> 4];
        line += digits[byte & 15];
    }
    std::cout << line << std::endl;
}

int main(int, char** arguments) {
    DomainParticipant* participant = on_loopback(std::stoi(arguments[1]));
    Subscriber* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    std::vector<Reader> readers;
    std::string name, type, reliable, latched;
    while (std::cin >> name >> type >> reliable >> latched) {
        TypeSupport any(new AnyType(dds_type(type)));
        participant->register_type(any);
        Topic* topic = participant->create_topic("rt" + name, dds_type(type), TOPIC_QOS_DEFAULT);
        DataReaderQos qos;
        qos.reliability().kind = reliable == "1" ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
        qos.durability().kind = latched == "1" ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
        qos.history().depth = 10;
        qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        readers.push_back({name, type, subscriber->create_datareader(topic, qos)});
    }
    std::cout << "ready" << std::endl;
    for (;; std::this_thread::sleep_for(std::chrono::milliseconds(10))) {
        for (const auto& reader : readers) {
            Bytes bytes;
            SampleInfo info;
            while (reader.reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
                if (info.valid_data) {
                    print(reader, bytes);
                }
            }
        }
    }
}
