// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/training.h"

#include "tarsier/core/errors.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::plate {
namespace {

// A crop that shows `text`; '-' is hidden.
LabelledCrop crop_of(const std::string& text) {
  LabelledCrop crop;
  crop.image = cv::Mat(44, 200, CV_8UC3, cv::Scalar::all(230));
  crop.length = static_cast<int>(text.size());
  for (std::size_t k = 0; k < text.size(); ++k) {
    if (text[k] == '-') continue;
    const cv::Rect2f box(10.0F + 26.0F * static_cast<float>(k), 8, 18, 28);
    cv::rectangle(crop.image, cv::Rect(box), cv::Scalar::all(30), cv::FILLED);
    crop.symbols.push_back({text[k], box, static_cast<int>(k)});
  }
  return crop;
}

std::string text_of(const LabelledCrop& crop) {
  std::string text(static_cast<std::size_t>(crop.length), '-');
  for (const auto& symbol : crop.symbols)
    text[static_cast<std::size_t>(symbol.place)] = symbol.symbol;
  return text;
}

TEST(SplitCrops, NoPlateIsOnBothSides) {
  std::vector<LabelledCrop> crops;
  for (int plate = 0; plate < 40; ++plate) {
    const std::string text = std::to_string(1000 + 37 * plate) + "BCD";
    for (const std::size_t hidden : {0U, 4U}) {  // the same plate twice, other places hidden
      std::string shown = text;
      shown[hidden] = shown[hidden + 1] = '-';
      crops.push_back(crop_of(shown));
    }
  }
  const CropSplit split = split_crops(crops, 0.25, Rng(3));
  EXPECT_EQ(split.test.size(), 20U);
  EXPECT_GT(split.train.size(), 20U);
  for (const LabelledCrop& test : split.test) {
    for (const LabelledCrop& train : split.train) {
      int agree = 0;
      bool differ = false;
      for (std::size_t k = 0; k < 7; ++k) {
        const char a = text_of(test)[k];
        const char b = text_of(train)[k];
        if (a == '-' || b == '-') continue;
        agree += a == b;
        differ = differ || a != b;
      }
      EXPECT_TRUE(differ || agree < 3) << text_of(test) << ' ' << text_of(train);
    }
  }
  EXPECT_EQ(split_crops(crops, 0, Rng(3)).test.size(), 0U);
  EXPECT_THROW((void)split_crops(crops, 1, Rng(3)), std::invalid_argument);
}

class Training : public testing::Test {
 protected:
  void SetUp() override {
    try {
      views_.glyphs = synth::load_glyphs();
    } catch (const InputError&) {
      GTEST_SKIP() << "no typefaces to draw plates with";
    }
    Rng rng(1);
    for (int k = 0; k < 3; ++k) {
      Scene scene;
      scene.image.create(240, 320, CV_8UC3);
      for (auto p = scene.image.begin<cv::Vec3b>(); p != scene.image.end<cv::Vec3b>(); ++p)
        *p = cv::Vec3b::all(static_cast<std::uint8_t>(rng.integer(60, 120)));
      cv::blur(scene.image, scene.image, {9, 9});
      views_.scenes.push_back(scene);
    }
  }
  ViewMaker views_;
};

TEST_F(Training, ExamplesHaveWhatTheNetworksTake) {
  linalg::Shape shape;
  std::vector<float> input;
  std::vector<float> target;
  bool positive = false;
  for (std::uint64_t k = 0; k < 10; ++k) {
    Rng rng = Rng(5).fork(k);
    make_detector_example(views_, rng, shape, input, target);
    ASSERT_EQ(input.size(), static_cast<std::size_t>(shape.width * shape.height));
    EXPECT_EQ(
        target.size() % static_cast<std::size_t>((shape.width / kCell) * (shape.height / kCell)),
        0U);
    positive = positive || std::count(target.begin(), target.end(), 1.0F) > 0;
    make_aligner_example(views_, rng, shape, input, target);
    EXPECT_EQ(shape.width, kAlignWidth);
    EXPECT_EQ(shape.height, kAlignHeight);
    make_line_example(views_, {}, rng, shape, input, target);
    EXPECT_EQ(shape.height, kLineHeight);
    ASSERT_EQ(target.size(), static_cast<std::size_t>(shape.width / kColumn));
    std::set<float> labels(target.begin(), target.end());
    EXPECT_GE(labels.size(), 3U) << "hardly any characters in the line";
  }
  EXPECT_TRUE(positive);
}

TEST_F(Training, ThreadsChangeNothing) {
  TrainingOptions options;
  options.line_steps = 2;
  NoProgress progress;
  const auto trained_on = [&](int threads) {
    cv::setNumThreads(threads);
    return train_line_reader(views_, {crop_of("1234BCD")}, options, progress, {});
  };
  const linalg::Network one = trained_on(1);
  const linalg::Network three = trained_on(3);
  cv::setNumThreads(-1);
  EXPECT_EQ(linalg::network_to_json(one), linalg::network_to_json(three));
  options.seed = 2;
  EXPECT_NE(linalg::network_to_json(one), linalg::network_to_json(trained_on(1)));
  cv::setNumThreads(-1);
}

TEST_F(Training, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  NoProgress progress;
  EXPECT_THROW((void)train_aligner(views_, {}, progress, stop.get_token()), Interrupted);
}

TEST_F(Training, ImpossibleOptionsAreRefused) {
  TrainingOptions options;
  options.line_steps = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
