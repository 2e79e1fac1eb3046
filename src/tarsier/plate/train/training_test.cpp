// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/training.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/text/country.h"
#include "tarsier/plate/text/text.h"
#include "tarsier/synth/glyphs.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

namespace tarsier::plate {
namespace {

// A crop that shows `text`; '-' is a hidden character.
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
    text[static_cast<std::size_t>(symbol.position)] = symbol.symbol;
  return text;
}

TEST(SplitCrops, NoPlateIsInBothSets) {
  std::vector<LabelledCrop> crops;
  for (int plate = 0; plate < 40; ++plate) {
    const std::string text = std::to_string(1000 + 37 * plate) + "BCD";
    // The same plate twice with other hidden characters.
    for (const std::size_t hidden : {0U, 4U}) {
      std::string visible = text;
      visible[hidden] = visible[hidden + 1] = '-';
      crops.push_back(crop_of(visible));
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
  ViewGenerator views_;
};

TEST_F(Training, ExamplesHaveTheShapesOfTheNetworks) {
  linalg::Shape shape;
  std::vector<float> input;
  std::vector<float> target;
  bool positive = false;
  for (std::uint64_t k = 0; k < 10; ++k) {
    Rng rng = Rng(5).fork(k);
    make_detector_example(views_, rng, shape, input, target);
    ASSERT_EQ(input.size(), static_cast<std::size_t>(shape.width * shape.height));
    EXPECT_EQ(target.size() %
                  static_cast<std::size_t>((shape.width / kCellSize) * (shape.height / kCellSize)),
              0U);
    positive = positive || std::count(target.begin(), target.end(), 1.0F) > 0;
    make_aligner_example(views_, rng, shape, input, target);
    EXPECT_EQ(shape.width, kAlignWidth);
    EXPECT_EQ(shape.height, kAlignHeight);
    make_line_example(views_, {}, rng, shape, input, target);
    EXPECT_EQ(shape.height, kLineHeight);
    ASSERT_EQ(target.size(), static_cast<std::size_t>(shape.width / kColumnStride));
    std::set<float> labels(target.begin(), target.end());
    EXPECT_GE(labels.size(), 3U) << "hardly any characters in the line";
  }
  EXPECT_TRUE(positive);
}

TEST_F(Training, ResultDoesNotDependOnThreads) {
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

TEST_F(Training, StopsOnRequest) {
  std::stop_source stop;
  stop.request_stop();
  NoProgress progress;
  EXPECT_THROW((void)train_aligner(views_, {}, progress, stop.get_token()), Interrupted);
}

TEST_F(Training, RejectsInvalidOptions) {
  TrainingOptions options;
  options.line_steps = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

// --- corrections ---

// A typeface that no reader was trained on: slanted strokes with a gap across their middle, as
// stencils leave it.
std::shared_ptr<const synth::GlyphSet> stencil(const synth::GlyphSet& known) {
  synth::GlyphSet::Typeface typeface = known.typefaces().front();
  typeface.name = "stencil";
  for (cv::Mat& mask : typeface.masks) {
    constexpr float kLean = 0.3F;
    const int wide = mask.cols + cvRound(kLean * static_cast<float>(mask.rows));
    const cv::Matx23f lean(1, -kLean, kLean * static_cast<float>(mask.rows), 0, 1, 0);
    cv::Mat leaning;
    cv::warpAffine(mask, leaning, lean, {wide, mask.rows});
    const int gap = mask.rows / 5;
    leaning.rowRange((mask.rows - gap) / 2, (mask.rows + gap) / 2).setTo(0);
    const cv::Rect ink = cv::boundingRect(leaning > 60);
    mask = ink.empty() ? mask : leaning(ink).clone();
  }
  typeface.digit_aspect += 0.3;
  return std::make_shared<const synth::GlyphSet>(std::vector{typeface, typeface});
}

// The crop that a log would store of a plate, and the plate's position in it.
cv::Mat logged_crop_of(const synth::GlyphSet& glyphs, Rng& rng, std::string& text, Quad& corners) {
  synth::PlateFaceOptions options;
  options.px_per_mm = 0.35F;
  options.random_style = false;
  const synth::PlateFace face = synth::render_plate_face(glyphs, options, rng);
  text = face.text;
  const cv::Point margin(face.image.cols / 6, face.image.rows / 4);
  cv::Mat crop(face.image.rows + 2 * margin.y, face.image.cols + 2 * margin.x, CV_8UC3,
               cv::Scalar(90, 95, 100));
  const cv::Rect plate_box(margin, face.image.size());
  face.image.copyTo(crop(plate_box));
  cv::GaussianBlur(crop, crop, {}, 0.6);
  corners = quad_of(cv::Rect2f(plate_box));
  return crop;
}

CharacterErrors errors_on(const Recognizer& recognizer, const synth::GlyphSet& glyphs) {
  CharacterErrors errors;
  for (std::uint64_t k = 0; k < 40; ++k) {
    Rng rng = Rng(100).fork(k);
    std::string text;
    Quad corners;
    const cv::Mat crop = logged_crop_of(glyphs, rng, text, corners);
    const std::string read = recognizer.read_at(crop, corners).text;
    errors.characters += static_cast<int>(text.size());
    errors.wrong += std::min(edit_distance(text, read), static_cast<int>(text.size()));
  }
  return errors;
}

TEST_F(Training, TenCorrectionsReduceErrorsOnANewTypeface) {
  TARSIER_LONG_TEST();
  const std::string folder = TARSIER_SOURCE_MODELS;
  const ReaderModel before = read_reader_model(folder + "/plate-reader.json");
  const CountryChoice countries = choose_countries(read_countries(folder + "/countries"), {"es"});
  const auto recognizer_of = [&](const ReaderModel& model) {
    return Recognizer(read_detector_model(folder + "/plate-detector.json"), model, countries);
  };
  const Recognizer first = recognizer_of(before);
  const auto unknown = stencil(*views_.glyphs);
  std::vector<LabelledCrop> corrections;
  for (std::uint64_t k = 0; k < 10; ++k) {
    Rng rng = Rng(7).fork(k);
    std::string text;
    Quad corners;
    const cv::Mat crop = logged_crop_of(*unknown, rng, text, corners);
    const std::optional<TextCrop> cut = first.crop_text(crop, corners, text);
    ASSERT_TRUE(cut);
    LabelledCrop labelled;
    labelled.image = cut->image;
    labelled.length = static_cast<int>(text.size());
    for (std::size_t i = 0; i < text.size(); ++i)
      labelled.symbols.push_back({text[i], cut->boxes[i], static_cast<int>(i)});
    corrections.push_back(labelled);
  }
  TrainingOptions options;
  options.line_steps = 50;
  NoProgress progress;
  ReaderModel after = before;
  after.line = train_line_reader(views_, corrections, options, progress, {}, &before.line);
  const Recognizer second = recognizer_of(after);
  ReaderModel without = before;  // the same length, from synthetic plates only
  without.line = train_line_reader(views_, {}, options, progress, {}, &before.line);

  const CharacterErrors old_errors = errors_on(first, *unknown);
  const CharacterErrors new_errors = errors_on(second, *unknown);
  const CharacterErrors control = errors_on(recognizer_of(without), *unknown);
  const CharacterErrors old_known = errors_on(first, *views_.glyphs);
  const CharacterErrors new_known = errors_on(second, *views_.glyphs);
  std::printf(
      "characters wrong of %d: %d, after ten corrections %d, without them %d; of a known typeface "
      "%d, %d\n",
      old_errors.characters, old_errors.wrong, new_errors.wrong, control.wrong, old_known.wrong,
      new_known.wrong);
  EXPECT_GT(old_errors.wrong, 40);
  EXPECT_LT(new_errors.wrong, old_errors.wrong / 2);
  EXPECT_LT(new_errors.wrong, control.wrong / 2);
  EXPECT_LE(new_known.wrong, old_known.wrong + 6);
}

TEST_F(Training, KeepAveragesOldAndNewWeights) {
  Rng rng(5);
  linalg::Network start = line_network();
  linalg::initialize(start, rng);
  TrainingOptions options;
  options.line_steps = 2;
  NoProgress progress;
  const auto train = [&](double keep) {
    options.keep = keep;
    return train_line_reader(views_, {}, options, progress, {}, &start);
  };
  const linalg::Network whole = train(0);
  const linalg::Network mean = train(0.25);
  const linalg::Network none = train(1);
  double moved = 0;
  for (std::size_t k = 0; k < start.layers.size(); ++k) {
    for (std::size_t i = 0; i < start.layers[k].weights.size(); ++i) {
      const float before = start.layers[k].weights[i];
      const float after = whole.layers[k].weights[i];
      moved += std::abs(static_cast<double>(after - before));
      ASSERT_NEAR(mean.layers[k].weights[i], 0.75F * after + 0.25F * before, 1e-6F);
      ASSERT_FLOAT_EQ(none.layers[k].weights[i], before);
    }
  }
  EXPECT_GT(moved, 0.1);
}

TEST_F(Training, RejectsAStartNetworkWithOtherLayers) {
  TrainingOptions options;
  options.line_steps = 1;
  NoProgress progress;
  const linalg::Network other = aligner_network();
  EXPECT_THROW((void)train_line_reader(views_, {}, options, progress, {}, &other),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
