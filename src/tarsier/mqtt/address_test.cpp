// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/address.h"

#include "tarsier/core/errors.h"
#include "tarsier/mqtt/discovery.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace tarsier::mqtt {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Address parse(const std::string& text) { return parse_address(text, "tarsier/here", "--publish"); }

std::string error_of(const std::string& text) {
  try {
    (void)parse(text);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "no error";
}

TEST(AddressTest, AllPartsAreParsed) {
  const Address plain = parse("mqtt://broker");
  EXPECT_EQ(address_text(plain), "mqtt://broker:1883/tarsier/here");
  EXPECT_FALSE(plain.tls);
  const Address full = parse("mqtts://ann:p%40ss%3A@10.0.0.1:9999/site/gate-1");
  EXPECT_EQ(full.user, "ann");
  EXPECT_EQ(full.password, "p@ss:");
  EXPECT_EQ(address_text(full), "mqtts://10.0.0.1:9999/site/gate-1");
  EXPECT_EQ(parse("mqtts://broker/").port, 8883);
  EXPECT_EQ(parse("mqtts://broker/").topic, "tarsier/here");
  const Address number = parse("mqtt://[::1]:1884/x");
  EXPECT_EQ(number.host, "::1");
  EXPECT_EQ(number.port, 1884);
  EXPECT_EQ(address_text(number), "mqtt://[::1]:1884/x");
}

TEST(AddressTest, ErrorsNameTheInvalidPartWithoutPasswords) {
  EXPECT_THAT(error_of("http://broker"), HasSubstr("--publish 'http://broker': expected mqtt://"));
  EXPECT_THAT(error_of("mqtt://"), HasSubstr("the host is missing"));
  EXPECT_THAT(error_of("mqtt://a b"), HasSubstr("the host"));
  EXPECT_THAT(error_of("mqtt://[::1"), HasSubstr("']' is missing"));
  for (const char* port : {":0", ":65536", ":x", ":", ":1 "})
    EXPECT_THAT(error_of(std::string("mqtt://broker") + port), HasSubstr("the port")) << port;
  for (const char* topic : {"/a/+", "/#", "//a", "/a//b", "/a b", "/a/", "/a\x01", "/$SYS"})
    EXPECT_THAT(error_of(std::string("mqtt://broker") + topic), HasSubstr("the topic")) << topic;
  EXPECT_THAT(error_of("mqtt://broker/" + std::string(201, 'a')), HasSubstr("the topic"));
  EXPECT_THAT(error_of("mqtt://a%0@broker"), HasSubstr("hexadecimal"));
  EXPECT_THAT(error_of("mqtt://a%0a@broker"), HasSubstr("control"));
  EXPECT_THAT(error_of("mqtt://ann:secret@broker/#"), Not(HasSubstr("secret")));
}

TEST(AddressTest, NodeNamesAreValidTopicLevels) {
  EXPECT_TRUE(is_node_name("gate-1.site_2"));
  for (const char* name : {"", "a/b", "a b", "+", "\xC3\xA9"}) EXPECT_FALSE(is_node_name(name));
  EXPECT_FALSE(is_node_name(std::string(65, 'a')));
  EXPECT_TRUE(is_node_name(machine_node_name()));
}

TEST(DiscoveryTest, HomeAssistantGetsRetainedConfigurations) {
  const auto messages = home_assistant_discovery("tarsier/gate-1", "0.1.0", "plate");
  ASSERT_EQ(messages.size(), 2U);
  EXPECT_EQ(messages[0].topic, "homeassistant/sensor/tarsier_gate_1_plate/config");
  EXPECT_EQ(messages[1].topic, "homeassistant/binary_sensor/tarsier_gate_1_watch/config");
  for (const Message& message : messages) {
    EXPECT_TRUE(message.retained);
    const auto object = nlohmann::json::parse(message.payload);
    EXPECT_EQ(object.at("state_topic"), "tarsier/gate-1/events");
    EXPECT_EQ(object.at("availability_topic"), "tarsier/gate-1/state");
    EXPECT_EQ(object.at("device").at("identifiers").at(0), "tarsier_gate_1");
  }
  const auto people = home_assistant_discovery("tarsier/door", "0.1.0", "person");
  ASSERT_EQ(people.size(), 1U);
  EXPECT_EQ(people[0].topic, "homeassistant/sensor/tarsier_door_person/config");
  EXPECT_THROW((void)home_assistant_discovery("tarsier/door", "0.1.0", "cat"),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::mqtt
