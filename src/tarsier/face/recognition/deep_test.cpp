// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/deep.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/testing_deep.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

namespace tarsier::face::recognition {
namespace {

using nlohmann::json;
using testing::HasSubstr;

cv::Mat noise_chip(std::uint64_t seed) {
  Rng rng(seed);
  cv::Mat chip(kChipSize, kChipSize, CV_8UC3);
  for (int y = 0; y < kChipSize; ++y)
    for (int x = 0; x < 3 * kChipSize; ++x)
      chip.ptr<unsigned char>(y)[x] = static_cast<unsigned char>(rng.uniform(0, 255.99));
  return chip;
}

class DeepFile : public FolderTest {
 protected:
  void SetUp() override { write_manifest_of(tiny_deep_weights(1), folder_); }
  [[nodiscard]] std::string manifest() const { return path("tiny-weights_manifest.json"); }

  // The error of reading the manifest after `change`.
  std::string refusal(const std::function<void(json&)>& change) {
    json value = json::parse(contents(manifest()));
    change(value);
    std::ofstream(path("bad.json")) << value.dump();
    return refusal_of(path("bad.json"));
  }
  static std::string refusal_of(const std::string& file) {
    try {
      (void)build_deep_network(read_weights_manifest(file), file);
    } catch (const ModelError& error) {
      EXPECT_THAT(error.what(), HasSubstr(file));
      return error.what();
    }
    return "taken";
  }
};

TEST_F(DeepFile, ManifestGivesTheNetworkOfItsWeights) {
  const DeepWeights weights = tiny_deep_weights(1);
  const DeepNetwork expected = build_deep_network(weights, "made up");
  const DeepNetwork read = build_deep_network(read_weights_manifest(manifest()), manifest());
  EXPECT_EQ(read.fingerprint, expected.fingerprint);
  EXPECT_EQ(read.outputs(), kTinyOutputs);
  const cv::Mat chip = noise_chip(2);
  EXPECT_EQ(embed(read, chip), embed(expected, chip));
  EXPECT_THAT(shards_of_manifest(manifest()), testing::ElementsAre("tiny.bin"));
}

TEST_F(DeepFile, RoundTripKeepsTheNetwork) {
  const DeepWeights weights = read_weights_manifest(manifest());
  write_deep_weights(path("model.json"), weights, {{"terms", "none"}});
  const DeepNetwork read = read_deep_network(path("model.json"));
  const DeepNetwork expected = build_deep_network(weights, manifest());
  EXPECT_EQ(read.fingerprint, expected.fingerprint);
  const cv::Mat chip = noise_chip(3);
  EXPECT_EQ(embed(read, chip), embed(expected, chip));
}

TEST_F(DeepFile, RejectsShardsOfWrongLength) {
  const std::string bytes = contents(path("tiny.bin"));
  std::ofstream(path("tiny.bin"), std::ios::binary) << bytes.substr(0, bytes.size() - 1);
  EXPECT_THAT(refusal_of(manifest()), HasSubstr("its shards end within 'fc'"));
  std::ofstream(path("tiny.bin"), std::ios::binary) << bytes << 'x';
  EXPECT_THAT(refusal_of(manifest()), HasSubstr("1 bytes too many"));
  std::filesystem::remove(path("tiny.bin"));
  EXPECT_THROW((void)read_weights_manifest(manifest()), InputError);
}

TEST_F(DeepFile, RejectsMaliciousManifests) {
  EXPECT_THAT(refusal([](json& m) { m = json::object(); }), HasSubstr("a list is expected"));
  EXPECT_THAT(refusal([](json& m) { m[0].erase("paths"); }), HasSubstr("'paths'"));
  for (const char* name : {"../tiny.bin", "/etc/passwd", ".hidden", "", "a/b"})
    EXPECT_THAT(refusal([&](json& m) { m[0]["paths"][0] = name; }), HasSubstr("not a file name"));
  const auto first = [](json& m) -> json& { return m[0]["weights"][0]; };
  EXPECT_THAT(refusal([&](json& m) { first(m)["shape"] = {-1, 7, 3, 4}; }), HasSubstr("a size"));
  EXPECT_THAT(refusal([&](json& m) {
                first(m)["shape"] = {4096, 4096, 4096, 4096};
              }),
              HasSubstr("too large"));
  EXPECT_THAT(refusal([&](json& m) { first(m)["shape"] = {1.5}; }), HasSubstr("a size"));
  EXPECT_THAT(refusal([&](json& m) { first(m)["dtype"] = "int32"; }), HasSubstr("float32"));
  EXPECT_THAT(refusal([&](json& m) { first(m)["quantization"]["dtype"] = "uint16"; }),
              HasSubstr("uint8"));
  EXPECT_THAT(refusal([&](json& m) { first(m)["quantization"]["scale"] = 1e30; }),
              HasSubstr("'scale'"));
  EXPECT_THAT(refusal([&](json& m) { first(m)["name"] = "conv4_down/conv/bias"; }),
              HasSubstr("the same name"));
  EXPECT_THAT(refusal([&](json& m) { first(m)["name"] = "other/conv/filters"; }),
              HasSubstr("'other/conv/bias' is missing"));
  // The same number of weights in other shapes: the layers do not fit together.
  EXPECT_THAT(refusal([&](json& m) { first(m)["shape"] = {7, 7, 4, 3}; }), HasSubstr("bad.json"));
}

TEST_F(DeepFile, RejectsOtherAndTruncatedFiles) {
  write_deep_weights(path("model.json"), tiny_deep_weights(1), json::object());
  const std::string text = contents(path("model.json"));
  std::ofstream(path("half.json")) << text.substr(0, text.size() / 2);
  EXPECT_THROW((void)read_deep_network(path("half.json")), ModelError);
  Archive archive = read_archive(path("model.json"), "face-embedding", 1);
  archive.payload["tensors"][0]["levels"]["shape"] = {7, 7, 3, 5};
  write_archive(path("short.json"), archive);
  EXPECT_THROW((void)read_deep_network(path("short.json")), ModelError);
  archive.type = "face-background";
  write_archive(path("other.json"), archive);
  EXPECT_THROW((void)read_deep_network(path("other.json")), ModelError);
}

TEST(Deep, ScaleLayersAreFoldedIntoTheConvolutions) {
  DeepWeights weights = tiny_deep_weights(4);
  const cv::Mat chip = noise_chip(5);
  const std::vector<float> before = embed(build_deep_network(weights, "made up"), chip);
  // Filters and bias doubled, scale halved: the same network.
  for (DeepTensor& tensor : weights) {
    const bool doubled =
        tensor.name.ends_with("conv/filters") || tensor.name.ends_with("conv/bias");
    const double factor = doubled ? 2 : tensor.name.ends_with("scale/weights") ? 0.5 : 1;
    tensor.scale *= factor;
    tensor.min *= factor;
    for (float& value : tensor.values) value *= static_cast<float>(factor);
  }
  const std::vector<float> after = embed(build_deep_network(weights, "made up"), chip);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < after.size(); ++i) EXPECT_NEAR(after[i], before[i], 1e-4);
}

TEST(Deep, EmbeddingDependsOnColourAndPosition) {
  const DeepNetwork network = build_deep_network(tiny_deep_weights(6), "made up");
  const cv::Mat chip = noise_chip(7);
  const std::vector<float> plain = embed(network, chip);
  cv::Mat swapped(chip.size(), chip.type());
  for (int y = 0; y < chip.rows; ++y)
    for (int x = 0; x < chip.cols; ++x) {
      const auto bgr = chip.at<cv::Vec3b>(y, x);
      swapped.at<cv::Vec3b>(y, x) = {bgr[2], bgr[1], bgr[0]};
    }
  EXPECT_NE(embed(network, swapped), plain);
  EXPECT_NE(embed(network, chip.t()), plain);
  EXPECT_THROW((void)embed(network, chip(cv::Rect(0, 0, 149, 150))), std::invalid_argument);
  EXPECT_THROW((void)embed(network, cv::Mat(150, 150, CV_8UC1, cv::Scalar(0))),
               std::invalid_argument);
}

TEST(Deep, DoesNotDependOnTheThread) {
  const DeepNetwork network = build_deep_network(tiny_deep_weights(8), "made up");
  const cv::Mat chip = noise_chip(9);
  const std::vector<float> here = embed(network, chip);
  std::vector<float> there;
  std::thread([&] { there = embed(network, chip); }).join();
  EXPECT_EQ(there, here);
}

// A background of an untrained network, with synthetic faces.
Background tiny_background(std::uint64_t seed) {
  const SyntheticFaces others = synthetic_faces(12, 1, 0.2, 3, 100, {128, 160});
  BackgroundOptions options;
  options.components = 10;
  options.network =
      std::make_shared<const DeepNetwork>(build_deep_network(tiny_deep_weights(seed), "made up"));
  NoProgress quiet;
  return learn_background(others.faces, options, quiet, {});
}

RecognizerOptions deep_options() {
  RecognizerOptions options;
  options.algorithm = Algorithm::kDeep;
  return options;
}

TEST(DeepRecognizer, IdentifiesItsTrainingFaces) {
  const Background background = tiny_background(1);
  // Little variation of light: an untrained network gives nearly the same template for all images
  // of a person.
  const SyntheticFaces set = synthetic_faces(3, 3, 0.02, 1, 0, {128, 160});
  NoProgress quiet;
  const RecognizerOptions options = deep_options();
  const Recognizer model = train(set.faces, set.labels, options, quiet, {}, &background);
  EXPECT_NO_THROW(model.check());
  EXPECT_EQ(model.labels.size(), 3U);
  ASSERT_TRUE(model.calibration.has_value());
  for (std::size_t i = 0; i < set.faces.size(); ++i) {
    const auto people = identify(model, set.faces[i]);
    EXPECT_EQ(model.labels[static_cast<std::size_t>(people.front().person)], set.labels[i]);
  }
}

TEST(DeepRecognizer, FacesAndCoordinatesGiveTheSameModel) {
  const Background background = tiny_background(1);
  const SyntheticFaces set = synthetic_faces(3, 2, 0.2, 1, 0, {128, 160});
  Rows coordinates(static_cast<Eigen::Index>(set.faces.size()), coordinate_count(background));
  for (std::size_t i = 0; i < set.faces.size(); ++i) {
    const std::vector<float> row = coordinates_of(background, set.faces[i]);
    coordinates.row(static_cast<Eigen::Index>(i)) =
        Eigen::Map<const Eigen::RowVectorXf>(row.data(), coordinates.cols());
  }
  NoProgress quiet;
  const Recognizer a = train(set.faces, set.labels, deep_options(), quiet, {}, &background);
  const Recognizer b =
      train_coordinates(coordinates, set.labels, deep_options(), quiet, {}, background);
  EXPECT_LT((a.templates - b.templates).cwiseAbs().maxCoeff(), 1e-4);
  const Rows made = templates_of_coordinates(b, background, coordinates);
  const std::vector<float> probe = template_of(b, set.faces[3]);
  for (Eigen::Index k = 0; k < made.cols(); ++k)
    EXPECT_NEAR(made(3, k), probe[static_cast<std::size_t>(k)], 1e-4);
}

TEST(DeepRecognizer, RequiresItsNetworkForFaces) {
  Background background = tiny_background(1);
  const SyntheticFaces set = synthetic_faces(2, 2, 0.2, 1, 0, {128, 160});
  NoProgress quiet;
  const Recognizer model = train(set.faces, set.labels, deep_options(), quiet, {}, &background);
  Recognizer read = recognizer_from_text(recognizer_text(model), "made up");
  EXPECT_THROW((void)identify(read, set.faces[0]), std::invalid_argument);
  read.network = model.network;
  EXPECT_EQ(template_of(read, set.faces[0]), template_of(model, set.faces[0]));
  background.network = nullptr;
  EXPECT_THROW((void)train(set.faces, set.labels, deep_options(), quiet, {}, &background),
               std::invalid_argument);
  EXPECT_THROW((void)train(set.faces, set.labels, deep_options(), quiet, {}, nullptr),
               std::invalid_argument);
}

TEST(DeepRecognizer, CoordinatesOfTwoNetworksDiffer) {
  const Background background = tiny_background(1);
  Background other = background;
  other.network =
      std::make_shared<const DeepNetwork>(build_deep_network(tiny_deep_weights(2), "made up"));
  EXPECT_NE(fingerprint(background), fingerprint(other));
}

TEST_F(DeepFile, BackgroundStoresItsNetworkFingerprint) {
  const Background background = tiny_background(1);
  write_background(path("background.json"), background, json::object());
  EXPECT_EQ(read_background(path("background.json")).network_fingerprint,
            background.network->fingerprint);
}

TEST(Deep, ChipHasItsEyesAtTheTrainedPositions) {
  for (const cv::Size size : {cv::Size(128, 160), cv::Size(64, 80), cv::Size(400, 500)}) {
    cv::Mat crop(size, CV_8UC1, cv::Scalar(200));
    for (const double x : {0.27, 0.73}) {
      const cv::Point center(cvRound(x * size.width - 0.5), cvRound(0.34 * size.height - 0.5));
      cv::circle(crop, center, size.width / 25, cv::Scalar(0), cv::FILLED);
    }
    const cv::Mat before = crop.clone();
    const cv::Mat chip = chip_of_crop(crop);
    ASSERT_EQ(chip.type(), CV_8UC3);
    EXPECT_EQ(cv::norm(crop, before), 0) << "the crop is somebody else's";
    for (const double x : {75 - kChipEyeDistance / 2, 75 + kChipEyeDistance / 2}) {
      cv::Point2d sum;
      double weight = 0;
      for (int row = 30; row < 62; ++row)
        for (int column = cvRound(x) - 20; column < cvRound(x) + 20; ++column) {
          const double dark = 200 - chip.at<cv::Vec3b>(row, column)[0];
          sum += dark * cv::Point2d(column, row);
          weight += dark;
        }
      EXPECT_NEAR(sum.x / weight, x - 0.5, 0.7) << size;
      EXPECT_NEAR(sum.y / weight, 46.3 - 0.5, 0.7) << size;
    }
  }
}

}  // namespace
}  // namespace tarsier::face::recognition
