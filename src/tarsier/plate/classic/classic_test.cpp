// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/classic.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/classic/study.h"
#include "tarsier/plate/classic/xml_matrix.h"
#include "tarsier/plate/text/evaluation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>

namespace tarsier::plate {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

// Two noisy clusters, apart along both axes.
TEST(LinearSvm, SeparatesTwoClusters) {
  Rng rng(1);
  cv::Mat rows(80, 2, CV_32F);
  std::vector<int> labels;
  for (int i = 0; i < 80; ++i) {
    labels.push_back(i % 2 == 0 ? 1 : -1);
    rows.at<float>(i, 0) = static_cast<float>(rng.normal(labels.back() * 2.0, 0.5));
    rows.at<float>(i, 1) = static_cast<float>(rng.normal(labels.back() * -1.0, 0.5));
  }
  const LinearModel model = train_linear_svm(rows, labels, 1, 500, Rng(2));
  for (int i = 0; i < 80; ++i)
    EXPECT_GT(model.margin(rows.ptr<float>(i)) * labels[static_cast<std::size_t>(i)], 0) << i;
  EXPECT_GT(model.weights[0], 0);
  EXPECT_LT(model.weights[1], 0);
}

TEST(PlattScaling, ProbabilityIncreasesWithMargin) {
  std::vector<double> margins;
  std::vector<int> labels;
  for (int i = -20; i <= 20; ++i) {
    margins.push_back(i / 10.0);
    labels.push_back(i > 3 || (i > -3 && i % 2 == 0) ? 1 : -1);
  }
  const PlattScaling scaling = fit_platt_scaling(margins, labels);
  EXPECT_LT(scaling.probability(-2), 0.2);
  EXPECT_GT(scaling.probability(2), 0.8);
  EXPECT_LT(scaling.probability(-1), scaling.probability(1));
}

TEST(Mlp, LearnsXor) {
  Rng rng(3);
  cv::Mat rows(200, 2, CV_32F);
  std::vector<int> labels;
  for (int i = 0; i < 200; ++i) {
    const bool a = rng.uniform() < 0.5;
    const bool b = rng.uniform() < 0.5;
    rows.at<float>(i, 0) = static_cast<float>(rng.normal(a, 0.1));
    rows.at<float>(i, 1) = static_cast<float>(rng.normal(b, 0.1));
    labels.push_back(a == b ? 0 : 1);
  }
  MlpOptions options;
  options.hidden = 8;
  const Mlp net = train_mlp(rows, labels, 2, options, Rng(4));
  int right = 0;
  for (int i = 0; i < 200; ++i) {
    const std::vector<float> out = net.run(rows.ptr<float>(i));
    right += (out[1] > out[0]) == (labels[static_cast<std::size_t>(i)] == 1);
  }
  EXPECT_GE(right, 195);
}

TEST(CharacterFeatures, ProjectionsCountInkAndHogIgnoresContrast) {
  cv::Mat character(20, 20, CV_8UC1, cv::Scalar(0));
  character(cv::Rect(8, 0, 4, 20)).setTo(255);  // an upright bar
  const std::vector<float> f = projection_features(character, 5);
  ASSERT_EQ(f.size(), 65U);
  EXPECT_EQ(f[9], 1);
  EXPECT_EQ(f[0], 0);
  for (int y = 0; y < 20; ++y) EXPECT_EQ(f[static_cast<std::size_t>(20 + y)], 1);
  EXPECT_EQ(f[40 + 2], 255);
  EXPECT_EQ(f[40 + 0], 0);
  EXPECT_THROW((void)projection_features(cv::Mat(10, 10, CV_8UC1), 5), std::invalid_argument);
  EXPECT_EQ(hog_features(character, 4, 9), hog_features(character * 0.5, 4, 9))
      << "contrast must not matter";
}

TEST(UprightCorners, StartAtTopLeftForAnyAngle) {
  for (int angle = -40; angle <= 40; angle += 10) {
    const cv::RotatedRect box({100, 100}, {80, 20}, static_cast<float>(angle));
    for (const cv::RotatedRect& same :
         {box, cv::RotatedRect(box.center, {20, 80}, static_cast<float>(angle + 90))}) {
      const Quad quad = upright_corners(same);
      EXPECT_LT(quad[0].x, quad[1].x);
      EXPECT_LT(quad[0].y + quad[1].y, quad[2].y + quad[3].y);
      EXPECT_NEAR(cv::norm(quad[1] - quad[0]), 80, 0.1);
      const float slope = std::atan2(quad[1].y - quad[0].y, quad[1].x - quad[0].x);
      EXPECT_NEAR(static_cast<double>(slope) * 180 / CV_PI, angle, 0.5);
    }
  }
}

// A bright plate with dark bars on a dark car.
cv::Mat image_with_plate(double angle) {
  cv::Mat plate(110, 520, CV_8UC1, cv::Scalar(235));
  for (int i = 0; i < 7; ++i) cv::rectangle(plate, {60 + i * 62, 18, 36, 74}, cv::Scalar(20), 12);
  cv::Mat image(360, 640, CV_8UC1, cv::Scalar(60));
  cv::Mat map = cv::getRotationMatrix2D({260, 55}, angle, 0.35);
  map.at<double>(0, 2) += 60;
  map.at<double>(1, 2) += 125;
  cv::warpAffine(plate, image, map, image.size(), cv::INTER_AREA, cv::BORDER_TRANSPARENT);
  return image;
}

TEST(FindCandidates, FindsAndRectifiesAPlate) {
  for (const double angle : {0.0, 8.0, -12.0}) {
    const auto found = find_candidates(image_with_plate(angle), {}, Rng(1), nullptr);
    ASSERT_FALSE(found.empty()) << angle;
    bool good = false;
    for (const ClassicCandidate& candidate : found) {
      EXPECT_EQ(candidate.gray.size(), kPlateSize);
      const cv::Point2f center = (candidate.corners[0] + candidate.corners[2]) * 0.5F;
      good = good || cv::norm(center - cv::Point2f(320, 180)) < 12;
    }
    EXPECT_TRUE(good) << angle;
  }
}

TEST(FindCandidates, ReturnsNoneForSmallAndUniformImages) {
  for (const cv::Size size : {cv::Size{1, 1}, cv::Size{19, 300}, cv::Size{200, 200}})
    EXPECT_TRUE(
        find_candidates(cv::Mat(size, CV_8UC1, cv::Scalar(128)), {}, Rng(1), nullptr).empty());
}

TEST(FindSegments, ReturnsCharactersFromLeftToRight) {
  cv::Mat plate(99, 432, CV_8UC1, cv::Scalar(230));
  for (int i = 0; i < 7; ++i) {
    cv::rectangle(plate, {50 + i * 52, 16, 36, 66}, cv::Scalar(20), 9);
  }
  cv::circle(plate, {20, 50}, 5, cv::Scalar(20), cv::FILLED);  // a rivet
  const auto segments = find_segments(plate, 128, {});
  ASSERT_EQ(segments.size(), 7U);
  for (std::size_t i = 1; i < 7; ++i) EXPECT_GT(segments[i].box.x, segments[i - 1].box.x);
  EXPECT_EQ(segments[0].character.size(), cv::Size(20, 20));
}

CharacterSet bars() {
  CharacterSet set;
  set.symbols = "1L";
  Rng rng(5);
  for (int i = 0; i < 120; ++i) {
    cv::Mat character(20, 20, CV_8UC1, cv::Scalar(0));
    const int dx = rng.integer(-2, 2);
    character(cv::Rect(8 + dx, 0, 4, 20)).setTo(255);
    if (i % 2 == 1) character(cv::Rect(8 + dx, 16, 9, 4)).setTo(255);
    set.characters.push_back(character);
    set.labels.push_back(i % 2);
    set.groups.push_back(i / 4);
  }
  return set;
}

TEST(StudyReader, KeepsGroupsTogetherAndIsDeterministic) {
  const CharacterSet set = bars();
  const CharacterSplit split = split_characters(set, 80, Rng(1));
  EXPECT_EQ(split.train.size() + split.test.size(), 120U);
  for (const int a : split.train)
    for (const int b : split.test)
      EXPECT_NE(set.groups[static_cast<std::size_t>(a)], set.groups[static_cast<std::size_t>(b)]);
  StudyOptions options;
  options.thumbnail_sizes = {5};
  options.neurons = {4, 8};
  options.seeds = 2;
  options.train = 80;
  options.iterations = 60;
  NoProgress progress;
  const auto cells = study_reader(set, options, progress, {});
  ASSERT_EQ(cells.size(), 2U);
  EXPECT_LT(cells[1].mean(), 0.1);
  EXPECT_EQ(study_csv(cells), study_csv(study_reader(set, options, progress, {})));
}

class ModelFiles : public FolderTest {};

TEST_F(ModelFiles, CharacterReaderRoundTrips) {
  const CharacterSet set = bars();
  std::vector<int> all(set.characters.size());
  std::iota(all.begin(), all.end(), 0);
  for (const ReaderKind kind : {ReaderKind::kHog, ReaderKind::kMlp}) {
    CharacterReaderOptions options;
    options.kind = kind;
    const CharacterReader reader = train_character_reader(set, all, options, Rng(1));
    const std::string path = folder_ + "/reader.json";
    write_character_reader(path, reader, nlohmann::json::object());
    EXPECT_EQ(read_character_reader(path).probabilities(set.characters[3]),
              reader.probabilities(set.characters[3]));
    EXPECT_THROW((void)read_plate_svm(path), ModelError);
  }
}

TEST_F(ModelFiles, PcaSvmRoundTrips) {
  PlateSet set;
  Rng rng(3);
  for (int i = 0; i < 12; ++i) {
    cv::Mat& candidate = set.candidates.emplace_back(33, 144, CV_8UC1);
    for (int y = 0; y < candidate.rows; ++y)
      for (int x = 0; x < candidate.cols; ++x)
        candidate.at<unsigned char>(y, x) =
            static_cast<unsigned char>(rng.integer(0, i % 2 == 0 ? 255 : 100));
    set.labels.push_back(i % 2 == 0 ? 1 : -1);
  }
  PlateSvmOptions options;
  options.features = PlateFeatures::kPca;
  options.components = 5;
  const PlateSvm svm = train_plate_svm(set, options, Rng(1));
  const std::string path = folder_ + "/svm.json";
  write_plate_svm(path, svm, nlohmann::json::object());
  EXPECT_EQ(read_plate_svm(path).margin(set.candidates[3]), svm.margin(set.candidates[3]));
  EXPECT_THROW((void)read_character_reader(path), ModelError);
}

TEST_F(ModelFiles, ShippedModelsRoundTripByteForByte) {
  constexpr std::int64_t kMaxBytes = 100'000'000;
  const auto expect_same = [&](const std::string& name, const auto& read, const auto& write) {
    const std::string shipped = std::string(TARSIER_SOURCE_MODELS) + "/" + name;
    const std::string path = folder_ + "/" + name;
    write(path, read(shipped), read_any_archive(shipped).provenance);
    EXPECT_TRUE(read_file(path, kMaxBytes) == read_file(shipped, kMaxBytes)) << name;
  };
  expect_same("plate-svm.json", read_plate_svm, write_plate_svm);
  expect_same("plate-hog.json", read_character_reader, write_character_reader);
  expect_same("plate-mlp.json", read_character_reader, write_character_reader);
}

class XmlFiles : public FolderTest {};

TEST_F(XmlFiles, RejectsMalformedFiles) {
  for (const std::string& text :
       {std::string("<opencv_storage>") + std::string(300'000, '<'),
        std::string("<opencv_storage><a type_id=\"opencv-matrix\"><rows>2</rows><cols>2</cols>"
                    "<dt>f</dt><data>1 2 nan 4</data></a></opencv_storage>"),
        std::string("<opencv_storage><a type_id=\"opencv-matrix\"><rows>2</rows><cols>2</cols>"
                    "<dt>f</dt><data>1 2 3</data></a></opencv_storage>"),
        std::string("not xml"), std::string()}) {
    EXPECT_THROW((void)parse_xml_matrices(text, "a.xml"), InputError) << text.substr(0, 80);
  }
}

TEST(ClassicOnImages, ReadsMostTextbookPlates) {
  const char* data = std::getenv("TARSIER_DATA");
  const fs::path folder = fs::path(data == nullptr ? "" : data) / "plates-book";
  if (!fs::exists(folder / "truth.csv")) GTEST_SKIP() << "no plates-book in $TARSIER_DATA";
  const fs::path models = TARSIER_SOURCE_MODELS;
  const auto model = read_classic_model((models / "plate-svm.json").string(),
                                        (models / "plate-hog.json").string());
  std::vector<ImageReadings> readings;
  const auto truth = read_plate_truth((folder / "truth.csv").string());
  for (const auto& [name, plates] : truth) {
    ImageReadings one;
    one.image = name;
    one.plates = read_classic(read_image((folder / "images" / name).string()), *model, {}, nullptr);
    readings.push_back(one);
  }
  const PlateScores scores = evaluate_plates(readings, truth, {});
  EXPECT_GE(scores.exact, 9) << "of " << scores.texts;
}

}  // namespace
}  // namespace tarsier::plate
