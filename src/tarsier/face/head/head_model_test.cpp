// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/head/testing_head.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face::head {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using HeadModelFile = FolderTest;

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing";
}

TEST_F(HeadModelFile, RoundTrip) {
  for (const int modes : {0, 5}) {
    HeadModel model = testing_head(modes);
    model.outline = {16, 17, 24};
    write_head_model(path("head.json"), model, {{"data", "formulas"}});
    const HeadModel back = read_head_model(path("head.json"));
    EXPECT_EQ(back.mean, model.mean);
    EXPECT_EQ(back.modes, model.modes);
    EXPECT_EQ(back.deviation, model.deviation);
    EXPECT_EQ(back.noise, model.noise);
    EXPECT_EQ(back.mirror, model.mirror);
    EXPECT_EQ(back.outer_eyes, model.outer_eyes);
    EXPECT_EQ(back.landmark, model.landmark);
    EXPECT_EQ(back.connections, model.connections);
    EXPECT_EQ(back.outline, model.outline);
    EXPECT_EQ(back.trained_on, model.trained_on);
    EXPECT_EQ(read_any_archive(path("head.json")).type, "head-model");
  }
}

TEST_F(HeadModelFile, RejectsInvalidModels) {
  const json good = to_json(testing_head(3));
  const std::pair<std::function<void(json&)>, const char*> cases[] = {
      {[](json& v) { v.erase("mean"); }, "mean"},
      {[](json& v) {
         v["mean"]["shape"] = {2, 25};
       },
       "mean"},
      {[](json& v) {
         v["modes"]["shape"] = {25, 9};
       },
       "modes"},
      {[](json& v) {
         v["deviation"]["shape"] = {2, 1};
       },
       "deviation"},
      {[](json& v) { v["noise"] = 3; }, "noise"},
      // 1 / noise^2 exceeds the range of floating point.
      {[](json& v) {
         v["noise"] = pack(PackedArray<double>{{25, 1}, std::vector<double>(25, 1e-200)});
       },
       "noise"},
      {[](json& v) { v["mirror"][0] = 99; }, "mirror"},
      {[](json& v) { v["mirror"][0] = 1.5; }, "mirror"},
      {[](json& v) {
         v["outer_eyes"] = {0, 0};
       },
       "outer eye"},
      {[](json& v) {
         v["outer_eyes"] = {0, 25};
       },
       "outer eye"},
      {[](json& v) { v["landmark"].erase(0); }, "landmark"},
      {[](json& v) { v["landmark"][3] = 1e300; }, "landmark"},
      {[](json& v) {
         v["connections"] = {{0, 1, 2}};
       },
       "connections"},
      {[](json& v) {
         v["connections"] = {{0, 25}};
       },
       "connection"},
      {[](json& v) { v["connections"] = "all"; }, "connections"},
      {[](json& v) { v["outline"] = {25}; }, "outline"},
      {[](json& v) { v["outline"] = 3; }, "outline"},
      {[](json& v) { v["trained_on"] = -1; }, "trained_on"},
  };
  EXPECT_NO_THROW((void)head_model_from_json(good, "head.json"));
  for (const auto& [spoil, word] : cases) {
    json bad = good;
    spoil(bad);
    const std::string message =
        message_of([&] { (void)head_model_from_json(bad, "folder/head.json"); });
    EXPECT_THAT(message, HasSubstr(word)) << message;
    EXPECT_THAT(message, HasSubstr("folder/head.json")) << message;
  }
  write_archive(path("other.json"), {"shape-model", 1, json::object(), good});
  EXPECT_THROW((void)read_head_model(path("other.json")), ModelError);
  EXPECT_THROW((void)read_head_model(path("none.json")), ModelError);
}

TEST(HeadModel, MustBeSymmetric) {
  HeadModel model = testing_head(2);
  model.mean(1, 3) += 1;
  EXPECT_THAT(message_of([&] { model.check(); }), HasSubstr("not symmetric"));
  model = testing_head(2);
  model.modes.col(0).swap(model.modes.col(1));
  EXPECT_NO_THROW(model.check());
  model.modes(4, 1) += 0.1;
  EXPECT_THROW(model.check(), std::invalid_argument);
}

TEST(HeadModel, SelectedPointsKeepTheShapeCovariance) {
  HeadModel model = testing_head(4);
  model.outline = {24, 5, 8};
  const HeadModel part = select_points(model, {1, 0, 22, 8, 9, 24, 12, 13});
  part.check();
  EXPECT_THAT(part.mirror, ElementsAre(1, 0, 2, 4, 3, 5, 7, 6));
  EXPECT_EQ(part.outer_eyes, (std::array<int, 2>{1, 0}));
  EXPECT_THAT(part.outline, ElementsAre(5, 3));
  EXPECT_THAT(part.landmark, ElementsAre(101, 100, 122, 108, 109, 124, 112, 113));
  // The covariance of the points is the same.
  const auto covariance = [](const HeadModel& of) {
    return Eigen::MatrixXd(of.modes * of.deviation.cwiseAbs2().asDiagonal() * of.modes.transpose());
  };
  const Eigen::MatrixXd whole = covariance(model);
  const Eigen::MatrixXd selected = covariance(part);
  EXPECT_LT((selected.block<3, 3>(3 * 3, 3 * 5) - whole.block<3, 3>(3 * 8, 3 * 24)).norm(), 1e-9);
  EXPECT_LT((selected.block<3, 3>(0, 0) - whole.block<3, 3>(3, 3)).norm(), 1e-9);
  EXPECT_TRUE(select_points(model, {0, 2, 3, 22}).mirror.empty());
  EXPECT_THROW((void)select_points(model, {0, 1, 2}), std::invalid_argument);
  EXPECT_THROW((void)select_points(model, {0, 1, 2, 2}), std::invalid_argument);
  EXPECT_THROW((void)select_points(model, {0, 1, 2, 25}), std::invalid_argument);
}

class MappingFile : public FolderTest {
 protected:
  std::string error_of(const std::string& text) {
    std::ofstream(path("map.txt")) << text;
    return message_of([&] { (void)read_landmark_mapping(path("map.txt"), 25, 73); });
  }
};

TEST_F(MappingFile, IsReadAndChecked) {
  EXPECT_EQ(error_of("# nose and others\n0 16\n1 24 # right\n\n22 40\n23 5\n"), "nothing");
  const LandmarkMapping mapping = read_landmark_mapping(path("map.txt"), 25, 73);
  EXPECT_THAT(mapping.model_points, ElementsAre(0, 1, 22, 23));
  EXPECT_THAT(mapping.landmarks, ElementsAre(16, 24, 40, 5));
  EXPECT_THAT(error_of("0 1\n1 2\n2 3\n"), HasSubstr("3 pairs"));
  EXPECT_THAT(error_of(""), HasSubstr("0 pairs"));
  EXPECT_THAT(error_of("0 1\n1 2 3\n"), HasSubstr("line 2"));
  EXPECT_THAT(error_of("0 x\n"), HasSubstr("line 1"));
  EXPECT_THAT(error_of("0 1.5\n"), HasSubstr("line 1"));
  EXPECT_THAT(error_of("25 1\n"), HasSubstr("model point 25"));
  EXPECT_THAT(error_of("2 73\n"), HasSubstr("landmark 73"));
  EXPECT_THAT(error_of("-1 7\n"), HasSubstr("model point -1"));
  EXPECT_THAT(error_of("0 7\n0 8\n"), HasSubstr("second time"));
  EXPECT_THAT(error_of("0 7\n1 7\n"), HasSubstr("second time"));
  EXPECT_THAT(error_of("99999999999999999999 7\n"), HasSubstr("line 1"));
}

}  // namespace
}  // namespace tarsier::face::head
