// SPDX-License-Identifier: MIT
#include "tarsier/media/archive.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class ArchiveTest : public FolderTest {
 protected:
  [[nodiscard]] std::string path() const { return folder_ + "/model.json"; }
  [[nodiscard]] std::string refusal(const std::string& text,
                                    const ArchiveLimits& limits = {}) const {
    write_file_atomically(path(), text);
    try {
      (void)read_archive(path(), "test", 2, limits);
    } catch (const ModelError& error) {
      EXPECT_EQ(error.path(), path());
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      return error.what();
    }
    return "accepted";
  }
};

Archive sample() {
  Archive archive;
  archive.type = "test";
  archive.version = 2;
  archive.provenance = {{"program", "tarsier 0.1.0"}, {"seed", 7}};
  archive.payload = {
      {"third", 1.0 / 3}, {"tiny", 5e-324}, {"name", "M\xC3\xBCller \"x\"\n"}, {"list", {1, 2, 3}}};
  return archive;
}

TEST_F(ArchiveTest, RoundTripsExactlyAndDeterministically) {
  write_archive(path(), sample());
  const std::string first = read_file(path(), 100'000);
  const Archive archive = read_archive(path(), "test", 2);
  EXPECT_EQ(archive.type, "test");
  EXPECT_EQ(archive.version, 2);
  EXPECT_EQ(archive.provenance, sample().provenance);
  EXPECT_EQ(archive.payload, sample().payload);
  write_archive(path(), archive);
  EXPECT_EQ(read_file(path(), 100'000), first);
  EXPECT_EQ(first.rfind("{\n\"type\": \"test\"", 0), 0U);
}

TEST_F(ArchiveTest, RefusesValuesThatJsonCannotHold) {
  Archive archive = sample();
  archive.payload["list"][1] = std::numeric_limits<double>::quiet_NaN();
  try {
    write_archive(path(), archive);
    FAIL();
  } catch (const OutputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("payload.list[1] is not a finite number"));
  }
  archive = sample();
  archive.provenance["data"] = "\xFF";
  EXPECT_THROW(write_archive(path(), archive), OutputError);
  EXPECT_FALSE(std::filesystem::exists(path()));
  archive = sample();
  archive.payload = 3;
  EXPECT_THROW(write_archive(path(), archive), std::invalid_argument);
}

TEST_F(ArchiveTest, MissingOrOtherFilesAreModelErrors) {
  try {
    (void)read_archive(path(), "test", 1);
    FAIL();
  } catch (const ModelError& error) {
    EXPECT_EQ(error.what(), path() + ": no such file");
    EXPECT_EQ(error.kind(), ErrorKind::kModel);
  }
  EXPECT_THAT(refusal(""), HasSubstr("empty"));
  EXPECT_THAT(refusal("{"), HasSubstr("ends too early"));
  EXPECT_THAT(refusal("{\n \"type\": nonsense}"), HasSubstr("line 2, column 1"));
  EXPECT_THAT(refusal("[1,2]"), HasSubstr("not a Tarsier model file"));
  EXPECT_THAT(refusal(R"({"type":"other","version":1,"payload":{}})"),
              HasSubstr("type 'other', expected 'test'"));
  EXPECT_THAT(refusal(R"({"type":"test","version":3,"payload":{}})"), HasSubstr("update tarsier"));
  EXPECT_THAT(refusal(R"({"type":"test","version":0,"payload":{}})"), HasSubstr("version"));
  EXPECT_THAT(refusal(R"({"type":"test","version":99999999999999999999,"payload":{}})"),
              HasSubstr("version"));
  EXPECT_THAT(refusal(R"({"type":"test","version":18446744073709551615,"payload":{}})"),
              HasSubstr("version"));
  EXPECT_THAT(refusal(R"({"type":"test","version":1,"payload":[]})"), HasSubstr("payload"));
  EXPECT_THAT(refusal(R"({"type":"test","version":1,"payload":{"x":1e999}})"),
              HasSubstr("out of range"));
  EXPECT_EQ(refusal(R"({"type":"test","version":1,"payload":{}})"), "accepted");
}

TEST_F(ArchiveTest, RejectsTruncatedFiles) {
  write_archive(path(), sample());
  const std::string whole = read_file(path(), 100'000);
  for (std::size_t size = 0; size + 2 < whole.size(); ++size) {
    EXPECT_NE(refusal(whole.substr(0, size)), "accepted") << size;
  }
}

TEST_F(ArchiveTest, EnforcesLimitsBeforeParsing) {
  EXPECT_THAT(refusal(std::string(200'000, '[')), HasSubstr("nested deeper than 64"));
  EXPECT_THAT(refusal(std::string(100, '{')), HasSubstr("nested deeper"));
  std::string deep;
  for (int i = 0; i < 100'000; ++i) deep += "{\"a\":";
  EXPECT_THAT(refusal(deep), HasSubstr("nested deeper"));
  ArchiveLimits few;
  few.max_values = 100;
  std::string many = "[0";
  for (int i = 0; i < 200; ++i) many += ",0";
  EXPECT_THAT(refusal(many + "]", few), HasSubstr("more than 100 values"));
  ArchiveLimits small;
  small.max_bytes = 10;
  EXPECT_THAT(refusal(std::string(11, ' '), small), HasSubstr("limit"));
}

TEST_F(ArchiveTest, IgnoresBracketsInStrings) {
  const json value = parse_json(
      "{\"a\": \"" + std::string(500, '[') + "\\\"" + std::string(500, '{') + "\"}", "x");
  EXPECT_EQ(value["a"].get<std::string>().size(), 1001U);
}

TEST_F(ArchiveTest, LongTextsRoundTripInPlace) {
  const std::string data(3000, 'A');
  const std::string other(257, '/');
  const json value = {{"names", {{data, 1}, {"b", data}}},
                      {"escaped", data + "\n\"" + data},
                      {"list", {other, "short", data, json::object(), other}},
                      {"letters", data + "\xC3\xBC"},
                      {"z", other}};
  for (const int indent : {-1, 1}) EXPECT_EQ(parse_json(value.dump(indent), "x"), value);
  EXPECT_EQ(parse_json('"' + data + '"', "x"), json(data));
  // Sizes around the limit of long texts and their blocks.
  for (std::size_t size = 250; size < 400; ++size) {
    const json text = {std::string(size, 'x'), "y"};
    EXPECT_EQ(parse_json(text.dump(), "x"), text);
  }
  // Of two entries with the same name, the last one counts.
  EXPECT_EQ(parse_json(R"({"a": ")" + data + R"(", "a": ")" + other + R"("})", "x")["a"], other);
}

TEST_F(ArchiveTest, ErrorsAfterLongTextsHaveTheRightPosition) {
  const std::string data(3000, 'A');
  const std::string start = "{\"type\": \"test\", \"data\": \"" + data + "\"";
  EXPECT_THAT(refusal(start), HasSubstr("ends too early"));
  EXPECT_THAT(refusal(start + " ]"), HasSubstr("line 1, column 3029: not JSON at \"]\""));
  EXPECT_THAT(refusal(start + ",\n \"b\": ]}"), HasSubstr("line 2, column 7: not JSON at \"]}\""));
  EXPECT_THAT(refusal(start + ": 1}"), HasSubstr("line 1, column 3028: not JSON at \": 1}"));
  EXPECT_THAT(refusal("{\"type\": \"" + data), HasSubstr("ends too early"));
  EXPECT_THAT(refusal("{\"type\": \"" + data + "\x01\"}"), HasSubstr("column 3011: not JSON"));
  EXPECT_THAT(refusal("{\"type\": \"" + data + "\xFF\"}"), HasSubstr("column 3011: not UTF-8"));
}

TEST_F(ArchiveTest, TextMustBeUtf8) {
  for (const char* bad : {"\"\xFF\"", "\"\xC0\xAF\"", "\"\xED\xA0\x80\"", "\"\xF5\x80\x80\x80\"",
                          "\"\xE2\x82\"", "\"\\\xC3\""}) {
    EXPECT_THROW((void)parse_json(bad, "x"), InputError) << bad;
  }
  EXPECT_EQ(parse_json("\"\xE2\x82\xAC\xF0\x9F\x90\x92\"", "x").get<std::string>().size(), 7U);
}

TEST_F(ArchiveTest, RandomDamageThrowsOnlyModelError) {
  write_archive(path(), sample());
  const std::string whole = read_file(path(), 100'000);
  Rng rng(11);
  for (int round = 0; round < 3000; ++round) {
    std::string text = whole;
    for (int i = rng.integer(1, 5); i > 0; --i) {
      text[static_cast<std::size_t>(rng.integer(0, static_cast<int>(text.size()) - 1))] =
          static_cast<char>(rng.integer(0, 255));
    }
    try {
      (void)parse_json(text, "x");
    } catch (const InputError&) {
    }
  }
}

TEST(Pack, ArraysRoundTripBitForBit) {
  for (std::size_t count = 0; count < 8; ++count) {
    PackedArray<double> array{{static_cast<std::int64_t>(count), 1}, {}};
    for (std::size_t i = 0; i < count; ++i)
      array.values.push_back(1.0 / (static_cast<double>(i) + 3) * (i % 2 == 0 ? 1 : -1e-310));
    const json packed = parse_json(pack(array).dump(), "x");
    const auto back = unpack<double>(packed, "m", "a", {-1, 1});
    EXPECT_EQ(back.shape, array.shape);
    EXPECT_EQ(back.values, array.values);
  }
  EXPECT_EQ(unpack<float>(pack(PackedArray<float>{{2}, {1.5F, -2}}), "m", "a", {2}).values,
            (std::vector<float>{1.5F, -2}));
  EXPECT_EQ(
      unpack<std::int32_t>(pack(PackedArray<std::int32_t>{{1, 2}, {-7, 1 << 30}}), "m", "a", {1, 2})
          .values,
      (std::vector<std::int32_t>{-7, 1 << 30}));
  EXPECT_EQ(unpack<std::uint8_t>(pack(PackedArray<std::uint8_t>{{3}, {0, 128, 255}}), "m", "a", {3})
                .values,
            (std::vector<std::uint8_t>{0, 128, 255}));
  EXPECT_EQ(unpack<double>(pack(PackedArray<double>{{}, {4}}), "m", "a", {}).values,
            std::vector<double>{4});
}

TEST(Pack, LayoutInTheFileIsFixed) {
  const json packed = pack(PackedArray<double>{{1}, {1.0}});
  EXPECT_EQ(packed.dump(), R"({"data":"AAAAAAAA8D8=","dtype":"f8","shape":[1]})");
  const json half = pack_half({{2}, {1, -2}});
  EXPECT_EQ(half.dump(), R"({"data":"ADwAwA==","dtype":"f2","shape":[2]})");
}

TEST(Pack, HalfPrecisionKeepsElevenBits) {
  const std::vector<float> values{0, -1, 1.0F / 3, 1e-4F, -1234.5F, 65504};
  const auto back = unpack<float>(pack_half({{2, 3}, values}), "m", "a", {2, 3});
  EXPECT_EQ(back.shape, (std::vector<std::int64_t>{2, 3}));
  for (std::size_t i = 0; i < values.size(); ++i) {
    EXPECT_NEAR(back.values[i], values[i], std::abs(values[i]) / 2048);
    EXPECT_EQ(back.values[i], rounded_to_half(values[i]));
    EXPECT_EQ(rounded_to_half(back.values[i]), back.values[i]);
  }
  EXPECT_THROW((void)pack_half({{1}, {1e6F}}), std::invalid_argument);
  EXPECT_THROW((void)pack_half({{1}, {NAN}}), std::invalid_argument);
  EXPECT_THROW((void)pack_half({{2}, {1}}), std::invalid_argument);
  // Infinity, and an array of another type.
  const json infinite{{"dtype", "f2"}, {"shape", {1}}, {"data", "AHw="}};
  EXPECT_THROW((void)unpack<float>(infinite, "m", "a", {1}), ModelError);
  EXPECT_THROW((void)unpack<double>(pack_half({{1}, {1}}), "m", "a", {1}), ModelError);
}

TEST(Pack, InvalidArraysAreRefused) {
  const auto reason = [](const json& value) -> std::string {
    try {
      (void)unpack<double>(value, "m.json", "mean", {2, -1});
    } catch (const ModelError& error) {
      return error.what();
    }
    return "accepted";
  };
  const json good = pack(PackedArray<double>{{2, 1}, {1, 2}});
  EXPECT_EQ(reason(good), "accepted");
  const auto with = [&](const char* name, const json& value) {
    json changed = good;
    changed[name] = value;
    return reason(changed);
  };
  EXPECT_THAT(with("shape", {2, 2}), HasSubstr("m.json: mean: 16 bytes of data for 4 values"));
  EXPECT_THAT(with("shape", {1, 2}), HasSubstr("shape (1, 2), expected (2, -1)"));
  EXPECT_THAT(with("shape", {2, -1}), HasSubstr("makes no sense"));
  EXPECT_THAT(with("shape", {2, 4611686018427387904}), HasSubstr("makes no sense"));
  EXPECT_THAT(with("shape", {2, 18446744073709551615U}), HasSubstr("makes no sense"));
  EXPECT_THAT(with("shape", {2, 1.5}), HasSubstr("makes no sense"));
  EXPECT_THAT(with("shape", {2, 0x80000000}), HasSubstr("makes no sense"));
  EXPECT_THAT(with("shape", "x"), HasSubstr("no packed array"));
  EXPECT_THAT(with("dtype", "f4"), HasSubstr("dtype 'f4', expected 'f8'"));
  EXPECT_THAT(with("data", "AAA"), HasSubstr("base64"));
  EXPECT_THAT(with("data", "===="), HasSubstr("base64"));
  EXPECT_THAT(with("data", "AA*A"), HasSubstr("base64"));
  EXPECT_THAT(with("data", "AAAAAAAA8D8AAAAAAAAA*A=="), HasSubstr("base64"));
  EXPECT_THAT(with("data", "AAAAAAAA8D8AAAAAAAAAQ==="), HasSubstr("base64"));
  EXPECT_THAT(with("data", "AAAAAAAA8D8AAA=AAAAAQA=="), HasSubstr("base64"));
  EXPECT_THAT(with("data", "AAAAAAAA+H8AAAAAAADwPw=="), HasSubstr("not finite"));
  EXPECT_THAT(reason(json(3)), HasSubstr("no packed array"));
  EXPECT_THROW((void)pack(PackedArray<double>{{3}, {1}}), std::invalid_argument);
  EXPECT_THROW((void)pack(PackedArray<double>{{1}, {std::numeric_limits<double>::infinity()}}),
               std::invalid_argument);
}

TEST(Pack, SizesWhoseProductOverflowsAreRefused) {
  // The product of these is 2^64, which is 0 in 64 bits; and 0.
  for (const auto& shape : {json{1LL << 32, 1LL << 32}, json{1LL << 40, 0}, json{0, 1LL << 31}}) {
    const json value = {{"dtype", "f8"}, {"shape", shape}, {"data", ""}};
    EXPECT_THROW((void)unpack<double>(value, "m", "a", {-1, -1}), ModelError) << shape.dump();
  }
  const json empty = {{"dtype", "f8"}, {"shape", {0, 7}}, {"data", ""}};
  EXPECT_EQ(unpack<double>(empty, "m", "a", {-1, 7}).shape[0], 0);
}

TEST(Members, AreCheckedForTypeAndRange) {
  const json object = {{"n", 2.5}, {"i", 7}, {"t", "abc"}, {"huge", 18446744073709551615U}};
  EXPECT_EQ(number_member(object, "n", "m", 0, 3), 2.5);
  EXPECT_EQ(integer_member(object, "i", "m", 0, 7), 7);
  EXPECT_EQ(text_member(object, "t", "m"), "abc");
  EXPECT_THROW((void)number_member(object, "n", "m", 0, 2), ModelError);
  EXPECT_THROW((void)number_member(object, "t", "m"), ModelError);
  EXPECT_THROW((void)integer_member(object, "n", "m", 0, 9), ModelError);
  EXPECT_THROW((void)integer_member(object, "huge", "m", -9, 9), ModelError);
  EXPECT_THROW((void)text_member(object, "t", "m", 2), ModelError);
  EXPECT_THROW((void)member(object, "none", "m"), ModelError);
  EXPECT_THROW((void)member(json(3), "none", "m"), ModelError);
}

}  // namespace
}  // namespace tarsier
