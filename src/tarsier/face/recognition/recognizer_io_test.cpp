// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

namespace tarsier::face::recognition {
namespace {

using nlohmann::json;

class RecognizerFile : public FolderTest {
 protected:
  Recognizer model_of(Algorithm algorithm) {
    const auto set = synthetic_faces(3, 3, 0.2, 1);
    RecognizerOptions options;
    options.algorithm = algorithm;
    options.lbp.grid = 4;
    NoProgress quiet;
    return train(set.faces, set.labels, options, quiet, {});
  }

  // The error of read_recognizer() for a payload after `change`.
  std::string refusal(Algorithm algorithm, const std::function<void(json&)>& change) {
    const std::string good = path("good");
    write_recognizer(good, model_of(algorithm), json::object());
    Archive archive = read_archive(good, "face-recognizer", 1);
    change(archive.payload);
    write_archive(path("bad"), archive);
    try {
      (void)read_recognizer(path("bad"));
    } catch (const ModelError& error) {
      return error.what();
    }
    return "it was read";
  }
};

TEST_F(RecognizerFile, RoundTripKeepsTheScores) {
  const auto probes = synthetic_faces(4, 2, 0.3, 2);
  for (const auto algorithm :
       {Algorithm::kDefault, Algorithm::kEigen, Algorithm::kFisher, Algorithm::kLbph}) {
    const auto model = model_of(algorithm);
    write_recognizer(path("model"), model, {{"data", "synthetic"}});
    const auto back = read_recognizer(path("model"));
    EXPECT_EQ(back.labels, model.labels);
    ASSERT_EQ(back.calibration.has_value(), model.calibration.has_value());
    if (model.calibration) {
      EXPECT_EQ(back.calibration->threshold(0.01, 3), model.calibration->threshold(0.01, 3));
    }
    for (const auto& face : probes.faces) {
      const auto a = identify(model, face);
      const auto b = identify(back, face);
      ASSERT_EQ(a.size(), b.size());
      for (std::size_t i = 0; i < a.size(); ++i) {
        EXPECT_EQ(a[i].person, b[i].person);
        EXPECT_EQ(a[i].score, b[i].score);
      }
    }
    const auto before = contents(path("model"));
    write_recognizer(path("model"), back, {{"data", "synthetic"}});
    EXPECT_EQ(contents(path("model")), before) << name_of(algorithm);
  }
}

TEST_F(RecognizerFile, LabelsMayBeAnyText) {
  auto model = model_of(Algorithm::kEigen);
  model.labels = {"O'Neil \"x\" / ../..", std::string(10'000, 'a'), "\xC3\xA9"};
  write_recognizer(path("model"), model, json::object());
  EXPECT_EQ(read_recognizer(path("model")).labels, model.labels);
}

TEST_F(RecognizerFile, RoundTripKeepsAnEmptyGallery) {
  auto model = model_of(Algorithm::kDefault);
  for (const auto* label : {"p0", "p1", "p2"}) EXPECT_TRUE(remove_person(model, label));
  write_recognizer(path("model"), model, json::object());
  EXPECT_TRUE(
      identify(read_recognizer(path("model")), synthetic_faces(1, 1, 0, 1).faces.front()).empty());
}

TEST_F(RecognizerFile, RejectsMaliciousModels) {
  using testing::HasSubstr;
  const auto refuses = [&](const std::function<void(json&)>& change) {
    return refusal(Algorithm::kDefault, change);
  };
  EXPECT_THAT(refuses([](json& p) { p["options"]["algorithm"] = "magic"; }),
              HasSubstr("unknown recogniser 'magic'"));
  EXPECT_THAT(refuses([](json& p) { p["options"]["algorithm"] = "lbph"; }), HasSubstr("templates"));
  EXPECT_THAT(refuses([](json& p) { p["options"]["descriptor"]["width"] = 1'000'000; }),
              HasSubstr("width"));
  EXPECT_THAT(refuses([](json& p) { p["options"]["descriptor"]["width"] = 128; }),
              HasSubstr("inputs"));
  EXPECT_THAT(refuses([](json& p) { p["options"]["descriptor"]["channels"] = json::array(); }),
              HasSubstr("channels"));
  EXPECT_THAT(refuses([](json& p) { p["options"]["ridge"] = 0; }), HasSubstr("ridge"));
  EXPECT_THAT(refuses([](json& p) { p.erase("mean"); }), HasSubstr("mean"));
  EXPECT_THAT(refuses([](json& p) { p["labels"] = {"a", "b"}; }), HasSubstr("person 2"));
  EXPECT_THAT(refuses([](json& p) { p["labels"] = {"a", "b", "a"}; }), HasSubstr("twice"));
  EXPECT_THAT(refuses([](json& p) {
                p["labels"] = {"a", "b", "c", "d"};
              }),
              HasSubstr("without a template"));
  EXPECT_THAT(refuses([](json& p) { p["labels"] = {"a", 1, "c"}; }), HasSubstr("label"));
  EXPECT_THAT(refuses([](json& p) {
                p["people"] = pack(PackedArray<std::int32_t>{{9}, {0, 0, 0, 1, 1, 1, 2, 2, -1}});
              }),
              HasSubstr("person -1"));
  EXPECT_THAT(refuses([](json& p) {
                p["people"] = pack(PackedArray<std::int32_t>{{2}, {0, 1}});
              }),
              HasSubstr("people"));
  EXPECT_THAT(refuses([](json& p) {
                p["components"]["shape"] = {1'000'000'000, 1'000'000'000};
              }),
              HasSubstr("components"));
  EXPECT_THAT(refuses([](json& p) { p["calibration"]["scale"] = 0; }), HasSubstr("scale"));
  EXPECT_THAT(refuses([](json& p) { p["rest"] = 0; }), HasSubstr("rest"));
  EXPECT_THAT(refuses([](json& p) { p["options"] = 3; }), HasSubstr("bad"));
  EXPECT_THAT(refusal(Algorithm::kEigen, [](json& p) { p["options"]["width"] = 0; }),
              HasSubstr("size"));
  EXPECT_THAT(refusal(Algorithm::kLbph, [](json& p) { p["options"]["lbp"]["grid"] = 5; }),
              HasSubstr("templates"));
  EXPECT_THAT(refusal(Algorithm::kLbph,
                      [](json& p) {  // fewer pixels than cells
                        p["options"]["width"] = 8;
                        p["options"]["lbp"]["radius"] = 3;
                      }),
              HasSubstr("faces of 8x"));
  EXPECT_THAT(refusal(Algorithm::kLbph, [](json& p) { p["options"]["lbp"]["neighbours"] = 30; }),
              HasSubstr("neighbours"));
}

}  // namespace
}  // namespace tarsier::face::recognition
