// SPDX-License-Identifier: MIT
// Compares the real network with the package that it comes from, run in Node:
// bench/peers/face_embedding.mjs.
#include "tarsier/core/testing_long.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

namespace tarsier::face::recognition {
namespace {

using nlohmann::json;

class DeepPeer : public FolderTest {
 protected:
  void SetUp() override {
    const char* place = std::getenv("TARSIER_FACE_API");
    if (place == nullptr || !std::filesystem::exists(std::string(place) + "/model"))
      GTEST_SKIP() << "needs the npm package @vladmandic/face-api: $TARSIER_FACE_API is its folder";
    if (std::system("node --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "needs node";
    package_ = place;
  }
  std::string package_;
};

// A coloured texture with edges of all sizes.
cv::Mat drawn_chip(std::uint64_t seed) {
  const cv::Size size(kChipSize, kChipSize);
  Rng rng(seed);
  std::vector<cv::Mat> planes;
  for (int c = 0; c < 3; ++c) {
    const cv::Mat texture = 40 * random_texture(rng, size, 12) + 25 * random_texture(rng, size, 2) +
                            cv::Scalar(rng.uniform(90, 150));
    cv::Mat plane;
    texture.convertTo(plane, CV_8U);
    planes.push_back(plane);
  }
  cv::Mat chip;
  cv::merge(planes, chip);
  return chip;
}

TEST_F(DeepPeer, GivesTheSameNumbersOnTenImages) {
  TARSIER_LONG_TEST();
  const std::string manifest = package_ + "/model/face_recognition_model-weights_manifest.json";
  const DeepNetwork network = build_deep_network(read_weights_manifest(manifest), manifest);
  ASSERT_EQ(network.outputs(), 128);
  std::string command = std::string("node '") + TARSIER_SOURCE_MODELS +
                        "/../bench/peers/face_embedding.mjs' '" + package_ + "'";
  constexpr int kImages = 10;
  for (int i = 0; i < kImages; ++i) {
    const std::string file = path(std::to_string(i) + ".ppm");
    std::ofstream out(file, std::ios::binary);
    out << "P6\n" << kChipSize << " " << kChipSize << "\n255\n";
    const cv::Mat chip = drawn_chip(static_cast<std::uint64_t>(i) + 1);
    for (int y = 0; y < kChipSize; ++y)
      for (int x = 0; x < kChipSize; ++x)
        for (int c = 2; c >= 0; --c) out.put(static_cast<char>(chip.at<cv::Vec3b>(y, x)[c]));
    command += " '" + file + "'";
  }
  command += " >'" + path("out.jsonl") + "' 2>'" + path("err.txt") + "'";
  ASSERT_EQ(std::system(command.c_str()), 0) << contents(path("err.txt")).substr(0, 500);
  std::ifstream lines(path("out.jsonl"));
  std::string line;
  int count = 0;
  while (std::getline(lines, line)) {
    const json peer = json::parse(line)["embedding"];
    const std::vector<float> own =
        embed(network, drawn_chip(static_cast<std::uint64_t>(count) + 1));
    ASSERT_EQ(peer.size(), own.size());
    double square = 0;
    for (std::size_t i = 0; i < own.size(); ++i) {
      EXPECT_NEAR(own[i], peer[i].get<double>(), 1e-4) << "image " << count << ", number " << i;
      square += static_cast<double>(own[i]) * own[i];
    }
    EXPECT_GT(square, 0.1);
    ++count;
  }
  EXPECT_EQ(count, kImages);
}

}  // namespace
}  // namespace tarsier::face::recognition
