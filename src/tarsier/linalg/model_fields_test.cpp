// SPDX-License-Identifier: MIT
#include "tarsier/linalg/model_fields.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <nlohmann/json.hpp>

namespace tarsier::linalg {
namespace {

using nlohmann::json;
using testing::HasSubstr;

enum class Wood { kOak, kElm };
constexpr NameTable<Wood, 2> kWoods{"wood", {{{Wood::kOak, "oak"}, {Wood::kElm, "elm"}}}};

struct Leg {
  double length = 1;
};

struct Table {
  Wood wood = Wood::kElm;
  int legs = 4;
  bool round = false;
  std::string maker;
  Eigen::Matrix2Xd corners;
  Eigen::MatrixXd modes;
  Eigen::VectorXf row;     // as one row
  Eigen::VectorXd single;  // in single precision
  Eigen::MatrixXf halves;  // in half precision
  std::array<double, 2> ends{};
  std::vector<Leg> parts;
  std::optional<Leg> spare;
  std::int64_t serial = 0;  // 0: not written

  void check() const {
    if (legs == 3) throw std::invalid_argument("it would tip");
  }
};

void list_leg(ModelFields& file, Leg& leg) { file.number("length", leg.length, 0, 5); }
json to_json(const Leg& leg) { return written(leg, list_leg); }
Leg leg_from_json(const json& value, const std::string& path) {
  return read_fields<Leg>(value, path, list_leg);
}

void list_table(ModelFields& file, Table& table) {
  file.named("wood", table.wood, kWoods);
  file.whole("legs", table.legs, 1, 100);
  file.flag("round", table.round);
  file.text("maker", table.maker, 5);
  file.points("corners", table.corners, -1);
  file.require(table.corners.cols() >= 3, "{} corners", table.corners.cols());
  file.matrix("modes", table.modes, table.corners.size(), -1);
  file.matrix("row", table.row, 1, 3);
  file.matrix<float>("single", table.single, -1, 1);
  file.half_matrix("halves", table.halves, 1, 2);
  file.list<double>("ends", table.ends, 2);
  file.parts("parts", table.parts, 1, 3, list_leg);
  file.optional("spare", table.spare, leg_from_json);
  if (file.has("serial", table.serial != 0)) file.whole("serial", table.serial, 1);
}

Table example() {
  Table table;
  table.wood = Wood::kOak;
  table.round = true;
  table.maker = "Ann";
  table.corners = Eigen::Matrix2Xd{{0, 1, 2}, {3, 4, 5}};
  table.modes = Eigen::MatrixXd::Random(6, 2);
  table.row = Eigen::Vector3f(1, 2, 3);
  table.single = Eigen::Vector2d(0.5, 0.25);
  table.halves = Eigen::MatrixXf{{1, 2}};
  table.ends = {7, 8};
  table.parts = {{1}, {2}};
  return table;
}

Table read_table(const json& value) { return read_checked<Table>(value, "table.json", list_table); }

TEST(ModelFields, RoundTrip) {
  Table table = example();
  table.spare = Leg{3};
  table.serial = 17;
  const Table read = read_table(written(table, list_table));
  EXPECT_EQ(read.wood, Wood::kOak);
  EXPECT_EQ(read.legs, 4);
  EXPECT_TRUE(read.round);
  EXPECT_EQ(read.maker, "Ann");
  EXPECT_EQ(read.corners, table.corners);
  EXPECT_EQ(read.modes, table.modes);
  EXPECT_EQ(read.row, table.row);
  EXPECT_EQ(read.single, table.single);
  EXPECT_EQ(read.halves, table.halves);
  EXPECT_EQ(read.ends, table.ends);
  ASSERT_EQ(read.parts.size(), 2U);
  EXPECT_EQ(read.parts[1].length, 2);
  EXPECT_EQ(read.spare->length, 3);
  EXPECT_EQ(read.serial, 17);
}

TEST(ModelFields, JsonHasTheDocumentedFormat) {
  const Table table = example();
  const json value = written(table, list_table);
  EXPECT_EQ(value["wood"], "oak");
  EXPECT_EQ(value["legs"], 4);
  EXPECT_EQ(value["corners"], pack(PackedArray<double>{{3, 2}, {0, 3, 1, 4, 2, 5}}));
  EXPECT_EQ(value["row"], pack(PackedArray<float>{{1, 3}, {1, 2, 3}}));
  EXPECT_EQ(value["single"], pack(PackedArray<float>{{2, 1}, {0.5F, 0.25F}}));
  EXPECT_EQ(value["halves"], pack_half({{1, 2}, {1, 2}}));
  EXPECT_EQ(value["ends"], pack(PackedArray<double>{{2}, {7, 8}}));
  EXPECT_EQ(value["parts"], json({{{"length", 1.0}}, {{"length", 2.0}}}));
  EXPECT_FALSE(value.contains("spare"));
  EXPECT_FALSE(value.contains("serial"));
  // Row by row.
  const auto modes = unpack<double>(value["modes"], "", "modes", {6, 2});
  EXPECT_EQ(modes.values[1], table.modes(0, 1));
}

TEST(ModelFields, AnEmptyMatrixHasTheStatedSize) {
  Table table = example();
  table.modes.resize(0, 0);
  const json value = written(table, list_table);
  EXPECT_EQ(value["modes"]["shape"], json({6, 0}));
  EXPECT_EQ(read_table(value).modes.rows(), 6);
}

TEST(ModelFields, ErrorsNameTheInvalidField) {
  const json good = written(example(), list_table);
  const auto refusal = [&](const char* name, const json& value) -> std::string {
    json bad = good;
    bad[name] = value;
    if (value.is_null()) bad.erase(name);
    try {
      static_cast<void>(read_table(bad));
    } catch (const ModelError& error) {
      EXPECT_THAT(error.what(), HasSubstr("table.json"));
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(refusal("legs", 5), "accepted");
  EXPECT_THAT(refusal("wood", "tin"), HasSubstr("wood: is none of oak, elm"));
  EXPECT_THAT(refusal("legs", 101), HasSubstr("'legs' is 101, outside 1..100"));
  EXPECT_THAT(refusal("legs", 3), HasSubstr("it would tip"));
  EXPECT_THAT(refusal("round", 1), HasSubstr("'round' is not true or false"));
  EXPECT_THAT(refusal("maker", "Benjamin"), HasSubstr("'maker'"));
  EXPECT_THAT(refusal("corners", pack(PackedArray<double>{{1, 2}, {0, 0}})),
              HasSubstr("1 corners"));
  EXPECT_THAT(refusal("modes", pack(PackedArray<double>{{1, 1}, {0}})), HasSubstr("shape (1, 1)"));
  EXPECT_THAT(refusal("row", nullptr), HasSubstr("'row' is missing"));
  EXPECT_THAT(refusal("parts", json::array()), HasSubstr("parts: a list of 1 to 3"));
  EXPECT_THAT(refusal("parts", json::array({{{"length", 9}}})), HasSubstr("'length' is 9"));
  EXPECT_THAT(refusal("spare", 4), HasSubstr("expected an object"));
  EXPECT_THAT(refusal("serial", 0), HasSubstr("'serial'"));
}

}  // namespace
}  // namespace tarsier::linalg
