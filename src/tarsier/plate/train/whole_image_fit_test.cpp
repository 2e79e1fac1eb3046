// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/whole_image_fit.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/text/country.h"
#include "tarsier/plate/train/logistic.h"
#include "tarsier/synth/street.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

namespace tarsier::plate {
namespace {

TEST(FitLogistic, FindsTheLogOddsOfTheData) {
  // 20 of 100 rows with x = 0 are right, and 80 of 100 with x = 1.
  LogisticRows data;
  for (int i = 0; i < 100; ++i) {
    data.add({1, 0}, i < 20);
    data.add({1, 1}, i < 80);
  }
  const std::vector<double> w = fit_logistic(data, {1e-9, 1e-9});
  ASSERT_EQ(w.size(), 2U);
  EXPECT_NEAR(w[0], std::log(0.25), 1e-6);
  EXPECT_NEAR(w[0] + w[1], std::log(4), 1e-6);
  EXPECT_LT(fit_logistic(data, {1e-9, 100})[1], 1);  // limited by the regularisation
  EXPECT_THROW((void)fit_logistic({}, {}), std::invalid_argument);
  EXPECT_THROW((void)fit_logistic(data, {1}), std::invalid_argument);
  data.add({1}, true);
  EXPECT_THROW((void)fit_logistic(data, {1, 1}), std::invalid_argument);
}

TEST(FitLogistic, StaysFiniteForSeparableData) {
  LogisticRows data;
  for (int i = 0; i < 20; ++i) data.add({1, i * 1000.0}, i >= 10);
  const std::vector<double> w = fit_logistic(data, {1e-6, 1e-6});
  for (const double value : w) ASSERT_TRUE(std::isfinite(value));
  EXPECT_LT(w[0] + 9000 * w[1], 0);
  EXPECT_GT(w[0] + 10000 * w[1], 0);
}

class WholeImageFit : public FolderTest {
 protected:
  // Synthetic cars with ground truth.
  [[nodiscard]] std::string draw(const std::string& name, int count) const {
    const std::filesystem::path folder = std::filesystem::path(folder_) / name;
    std::filesystem::create_directories(folder / "images");
    std::ofstream truth(folder / "truth.csv");
    truth << "image,x,y,w,h,text\n";
    synth::StreetOptions options;
    options.size = {800, 500};
    for (int i = 0; i < count; ++i) {
      const synth::StreetImage street = synth::render_car(options, static_cast<std::uint64_t>(i));
      const std::string image = fmt::format("{}.png", i);
      write_image((folder / "images" / image).string(), street.image);
      for (const synth::StreetPlate& plate : street.plates) {
        const cv::Rect box = bounding_box(plate.corners, street.image.size());
        truth << fmt::format("{},{},{},{},{},{}\n", image, box.x, box.y, box.width, box.height,
                             plate.text);
      }
    }
    return folder.string();
  }
};

TEST_F(WholeImageFit, ClassifierSeparatesPlatesFromSigns) {
  std::string cars;
  try {
    cars = draw("cars", 7);
  } catch (const InputError& error) {
    GTEST_SKIP() << error.what();
  }
  const std::string models = TARSIER_SOURCE_MODELS;
  ReaderModel model = read_reader_model(models + "/plate-reader.json");
  const CalibrationCurve before = model.confidence_curve;
  model.plate_classifier.weights = {};
  NoProgress progress;
  const WholeImageCounts counts = fit_to_whole_images(
      read_detector_model(models + "/plate-detector.json"),
      choose_countries(read_countries(models + "/countries"), {}), {cars}, model, progress, {});
  EXPECT_EQ(counts.images, 7);
  EXPECT_GE(counts.plates, 7);
  EXPECT_GT(counts.detections, counts.plates);  // shop signs too
  EXPECT_GE(counts.texts, 7);
  EXPECT_LE(counts.correct, counts.texts);
  EXPECT_EQ(model.confidence_curve.weights, before.weights);  // too few texts
  // Now it separates plates from other texts.
  const Recognizer recognizer(read_detector_model(models + "/plate-detector.json"), model,
                              choose_countries(read_countries(models + "/countries"), {}));
  int returned = 0;
  for (int i = 0; i < counts.images; ++i)
    returned += static_cast<int>(
        recognizer.read(read_image(fmt::format("{}/images/{}.png", cars, i))).size());
  EXPECT_NEAR(returned, counts.texts, 0.2 * counts.texts);
}

TEST_F(WholeImageFit, RejectsFoldersWithoutImages) {
  ReaderModel model;
  NoProgress progress;
  EXPECT_THROW(
      static_cast<void>(fit_to_whole_images({}, {}, {folder_ + "/none"}, model, progress, {})),
      InputError);
}

}  // namespace
}  // namespace tarsier::plate
