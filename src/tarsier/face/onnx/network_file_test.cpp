// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/network_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/onnx/testing_onnx.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace tarsier::face::onnx {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using namespace testing_onnx;

std::string reason(const std::string& bytes) {
  try {
    (void)parse_network(bytes, "net.onnx");
  } catch (const ModelError& error) {
    return error.what();
  }
  return {};
}

std::string format_reason(std::string_view text) {
  try {
    (void)parse_input_format(text, "net.onnx.txt");
  } catch (const ModelError& error) {
    return error.what();
  }
  return {};
}

std::string with_tensor(const std::string& one) {
  return network({node("Relu", {"data"}, "out")}, {one}, {form("data", {1, 3, 16, 16})},
                 {form("out", {1, 3, 16, 16})});
}

TEST(NetworkFile, ReportsInputsOutputsAndSizes) {
  const std::string bytes =
      network({node("Conv", {"data", "w"}, "out", attribute("strides", {2, 2}))},
              {tensor("w", {2, 3, 1, 1}, std::vector<float>(6, 1))},
              {form("data", {1, 3, 0, 16}), form("w", {2, 3, 1, 1})}, {form("out", {1, 2, 8, 8})});
  const NetworkFile file = parse_network(bytes, "net.onnx");
  EXPECT_EQ(file.producer, "test");
  EXPECT_EQ(file.nodes, 1);
  EXPECT_EQ(file.parameters, 6);
  ASSERT_EQ(file.inputs.size(), 1U) << "what the file fills itself is no input";
  EXPECT_EQ(file.inputs[0].name, "data");
  EXPECT_THAT(file.inputs[0].shape, ElementsAre(1, 3, -1, 16));
  EXPECT_THAT(file.outputs[0].shape, ElementsAre(1, 2, 8, 8));
  EXPECT_EQ(file.sha256.size(), 64U);
}

// A truncated file is always reported as such.
TEST(NetworkFile, RejectsTruncatedFiles) {
  const std::string whole = means_of_fields();
  int refused = 0;
  for (std::size_t size = 0; size < whole.size(); ++size)
    if (!reason(whole.substr(0, size)).empty()) ++refused;
  // Only the part behind the network (the version of its operators) may be missing.
  EXPECT_GE(refused, static_cast<int>(whole.size()) - 5);
}

TEST(NetworkFile, SurvivesChangedBytes) {
  const std::string whole = means_of_fields();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const int change : {1, 0x80, 0xFF}) {
      std::string bytes = whole;
      bytes[at] = static_cast<char>(bytes[at] ^ change);
      (void)reason(bytes);
    }
  }
}

TEST(NetworkFile, RefusesWithTheReason) {
  EXPECT_THAT(reason(""), HasSubstr("holds no network"));
  EXPECT_THAT(reason(network({}, {}, {}, {})), HasSubstr("without layers"));
  const auto one_layer = [](const std::string& layer) {
    return network({layer}, {}, {form("data", {1, 3, 16, 16})}, {form("out", {1})});
  };
  EXPECT_THAT(reason(one_layer(node("Loop", {"data"}, "out"))), HasSubstr("a layer 'Loop'"));
  EXPECT_THAT(reason(one_layer(node("Conv", {"data"}, "out", attribute("group", {0})))),
              HasSubstr("'Conv': group of 0"));
  EXPECT_THAT(reason(one_layer(node("Conv", {"data"}, "out", attribute("strides", {1, 1 << 20})))),
              HasSubstr("strides of 1048576"));
  EXPECT_THAT(reason(one_layer(node("Relu", {"data"}, "out", field(5, field(6, std::string()))))),
              HasSubstr("network of its own"));
  EXPECT_THAT(reason(with_tensor(tensor("w", {2, 2}, {1, 2, 3}))), HasSubstr("another length"));
  EXPECT_THAT(reason(with_tensor(tensor("w", {1ULL << 40}, {1}))), HasSubstr("a side of"));
  EXPECT_THAT(reason(with_tensor(tensor("w", {1ULL << 20, 1ULL << 20}, {1}))),
              HasSubstr("larger than the file"));
  EXPECT_THAT(reason(with_tensor(field(2, 8) + field(8, std::string("w")))),
              HasSubstr("numbers of type 8"));
  EXPECT_THAT(
      reason(with_tensor(field(1, 1) + field(2, 1) + field(8, std::string("w")) + field(14, 1))),
      HasSubstr("another file"));
}

TEST(InputFormat, ParsesAllKeys) {
  const InputFormat format = parse_input_format(
      "# how it takes its image\n licence : Apache-2.0 \nsize: 112x96\nmean: 127.5\nscale: "
      "0.0078125\n",
      "net.onnx.txt");
  EXPECT_EQ(format.licence, "Apache-2.0");
  EXPECT_EQ(format.width, 112);
  EXPECT_EQ(format.height, 96);
  EXPECT_THAT(format.mean, ElementsAre(127.5));
  EXPECT_EQ(format.scale, 0.0078125);
  EXPECT_THAT(parse_input_format("mean: 1 2 3", "").mean, ElementsAre(1, 2, 3));
  EXPECT_EQ(parse_input_format("", "").width, 0);
}

TEST(InputFormat, RefusesWithTheLine) {
  EXPECT_THAT(format_reason("\nsiez: 112"), HasSubstr("net.onnx.txt: line 2: unknown word 'siez'"));
  for (const char* text : {"size: 8", "size: 112x", "size: axb", "size: 112x112x3"})
    EXPECT_THAT(format_reason(text), HasSubstr("size is")) << text;
  for (const char* text : {"mean:", "mean: 1 2", "mean: 1 2 3 4", "mean: nan", "mean: 1e9"})
    EXPECT_THAT(format_reason(text), HasSubstr("mean is")) << text;
  for (const char* text : {"scale: 0", "scale: -1", "scale: inf"})
    EXPECT_THAT(format_reason(text), HasSubstr("scale is")) << text;
}

}  // namespace
}  // namespace tarsier::face::onnx
