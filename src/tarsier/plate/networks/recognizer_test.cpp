// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/recognizer.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/networks/reading_json.h"
#include "tarsier/plate/text/country.h"
#include "tarsier/synth/plates.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::plate {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

const fs::path kModels = TARSIER_SOURCE_MODELS;

const Recognizer& recognizer() {
  static const Recognizer shared(
      read_detector_model((kModels / "plate-detector.json").string()),
      read_reader_model((kModels / "plate-reader.json").string()),
      choose_countries(read_countries((kModels / "countries").string()), {}));
  return shared;
}

struct DrawnPlate {
  std::string text;
  cv::Rect box;
};

// Plates in their standard style on a grey wall.
class RecognizerTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    try {
      glyphs_ = synth::load_glyphs();
    } catch (const InputError&) {
    }
  }
  void SetUp() override {
    if (glyphs_ == nullptr) GTEST_SKIP() << "no typefaces to draw plates with";
  }

  static cv::Mat gray_wall(cv::Size size) {
    return cv::Mat(size, CV_8UC3, cv::Scalar(90, 95, 100));
  }

  // Draws a Spanish plate `width` px wide with its corner at `at`.
  static DrawnPlate draw_plate(cv::Mat& image, const std::string& text, cv::Point at, int width,
                               synth::PlateKind kind = synth::PlateKind::kSpain) {
    synth::PlateFaceOptions options;
    options.kind = kind;
    options.text = text;
    options.random_style = false;
    options.px_per_mm = 2;
    Rng rng(7);
    const synth::PlateFace face = synth::render_plate_face(*glyphs_, options, rng);
    cv::Mat small;
    cv::resize(face.image, small, {width, width * face.image.rows / face.image.cols}, 0, 0,
               cv::INTER_AREA);
    const cv::Rect box = cv::Rect(at, small.size()) & cv::Rect(0, 0, image.cols, image.rows);
    small(box - at).copyTo(image(box));
    return {face.text, box};
  }

  static std::shared_ptr<const synth::GlyphSet> glyphs_;
};
std::shared_ptr<const synth::GlyphSet> RecognizerTest::glyphs_;

TEST_F(RecognizerTest, ReadsSmallAndLargePlates) {
  for (const int width : {80, 130, 220, 400}) {
    cv::Mat image = gray_wall({640, 480});
    const DrawnPlate plate = draw_plate(image, "4725BKZ", {120, 200}, width);
    const std::vector<Reading> readings = recognizer().read(image);
    ASSERT_EQ(readings.size(), 1U) << width;
    EXPECT_EQ(readings[0].text, "4725BKZ") << width;
    EXPECT_GT(readings[0].confidence, 0.5) << width;
    EXPECT_GT(box_iou(readings[0].corners, quad_of(cv::Rect2f(plate.box))), 0.75) << width;
    EXPECT_EQ(readings[0].characters.size(), 7U);
  }
}

TEST_F(RecognizerTest, GreyAndColourGiveTheSameReading) {
  cv::Mat image = gray_wall({640, 480});
  draw_plate(image, "0318GHT", {200, 220}, 180);
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  const std::vector<Reading> of_gray = recognizer().read(gray);
  const std::vector<Reading> of_color = recognizer().read(image);
  ASSERT_EQ(of_gray.size(), 1U);
  EXPECT_EQ(reading_json(of_gray[0]), reading_json(of_color.at(0)));
}

TEST_F(RecognizerTest, ReadsTwoRowPlates) {
  cv::Mat image = gray_wall({640, 480});
  draw_plate(image, "5521MNP", {220, 150}, 190, synth::PlateKind::kSpainSquare);
  const std::vector<Reading> readings = recognizer().read(image);
  ASSERT_FALSE(readings.empty());
  EXPECT_EQ(readings[0].text, "5521MNP");
  EXPECT_EQ(readings[0].rows, 2);
}

TEST_F(RecognizerTest, ReadsNinetyOfAHundredPlates) {
  cv::Mat image = gray_wall({1600, 1200});
  std::set<std::string> texts;
  for (int i = 0; i < 100; ++i) {
    const std::string text = std::to_string(1000 + i * 83) + "BCD";
    texts.insert(draw_plate(image, text, {15 + (i % 10) * 158, 30 + (i / 10) * 116}, 130).text);
  }
  int right = 0;
  for (const Reading& reading : recognizer().read(image)) right += texts.erase(reading.text) == 1;
  EXPECT_GE(right, 90);
}

TEST_F(RecognizerTest, SearchesOnlyTheGivenRegion) {
  cv::Mat image = gray_wall({1280, 720});
  draw_plate(image, "4725BKZ", {200, 200}, 180);
  draw_plate(image, "0318GHT", {800, 500}, 180);
  ASSERT_EQ(recognizer().read(image).size(), 2U);
  const std::vector<Reading> right =
      recognizer().read(image, nullptr, nullptr, false, {640, 360, 640, 360});
  ASSERT_EQ(right.size(), 1U);
  EXPECT_EQ(right[0].text, "0318GHT");  // position in the whole image
  EXPECT_GT(box_iou(right[0].corners, quad_of({800, 500, 180, 38})), 0.7);
  EXPECT_TRUE(recognizer().read(image, nullptr, nullptr, false, {640, 0, 640, 360}).empty());
}

TEST_F(RecognizerTest, FindsASmallPlateInALargeImage) {
  cv::Mat image = gray_wall({3840, 2160});
  const DrawnPlate plate = draw_plate(image, "4725BKZ", {900, 1200}, 60);
  RecognizerOptions options;
  options.detector.max_tiles = 0;  // 16 px in the finest level
  const Recognizer coarse(read_detector_model((kModels / "plate-detector.json").string()),
                          read_reader_model((kModels / "plate-reader.json").string()),
                          choose_countries(read_countries((kModels / "countries").string()), {}),
                          options);
  EXPECT_TRUE(coarse.read(image).empty());
  const std::vector<Reading> readings = recognizer().read(image);
  ASSERT_EQ(readings.size(), 1U);
  EXPECT_EQ(readings[0].text, plate.text);
  EXPECT_GT(box_iou(readings[0].corners, quad_of(cv::Rect2f(plate.box))), 0.7);
}

TEST_F(RecognizerTest, RejectsTextThatIsNoPlate) {
  cv::Mat image = gray_wall({900, 500});
  draw_plate(image, "4725BKZ", {120, 330}, 220);
  // A badge, a grille, a row of lamps.
  cv::putText(image, "CAMARO", {512, 115}, cv::FONT_HERSHEY_DUPLEX, 1.2, {200, 200, 205}, 2,
              cv::LINE_AA);
  for (int i = 0; i < 12; ++i) {
    cv::rectangle(image, cv::Rect(520 + 20 * i, 300, 9, 46), {200, 200, 200}, cv::FILLED);
    cv::circle(image, {530 + 18 * i, 430}, 6, {210, 210, 240}, cv::FILLED, cv::LINE_AA);
  }
  const std::vector<Reading> readings = recognizer().read(image);
  ASSERT_EQ(readings.size(), 1U);
  EXPECT_EQ(readings[0].text, "4725BKZ");
  EXPECT_GT(readings[0].plate, 0.9);
}

TEST_F(RecognizerTest, BoxesAtTheBorderStayInTheImage) {
  for (const cv::Point at :
       {cv::Point{0, 0}, cv::Point{460, 0}, cv::Point{0, 442}, cv::Point{460, 442}}) {
    cv::Mat image = gray_wall({640, 480});
    draw_plate(image, "4725BKZ", at, 180);
    for (const Reading& reading : recognizer().read(image)) {
      EXPECT_EQ(reading.box & cv::Rect(0, 0, 640, 480), reading.box);
      EXPECT_EQ(reading.text, "4725BKZ");
    }
  }
}

TEST_F(RecognizerTest, ResultDoesNotDependOnThreads) {
  cv::Mat image = gray_wall({1280, 720});
  for (int i = 0; i < 6; ++i)
    draw_plate(image, std::to_string(1234 + 1111 * i) + "LMN",
               {60 + (i % 3) * 400, 150 + (i / 3) * 300}, 170);
  RecognizerOptions options;
  options.parallel = true;
  const Recognizer parallel(read_detector_model((kModels / "plate-detector.json").string()),
                            read_reader_model((kModels / "plate-reader.json").string()),
                            choose_countries(read_countries((kModels / "countries").string()), {}),
                            options);
  const std::vector<Reading> one = recognizer().read(image);
  const std::vector<Reading> many = parallel.read(image);
  ASSERT_EQ(one.size(), many.size());
  for (std::size_t i = 0; i < one.size(); ++i)
    EXPECT_EQ(reading_json(one[i]), reading_json(many[i]));
}

TEST_F(RecognizerTest, ReportsTheTextOfAnotherCountryAsUnfit) {
  cv::Mat image = gray_wall({640, 480});
  draw_plate(image, "4725BKZ", {200, 200}, 200);
  const auto of = [](const std::string& country) {
    return Recognizer(
        read_detector_model((kModels / "plate-detector.json").string()),
        read_reader_model((kModels / "plate-reader.json").string()),
        choose_countries(read_countries((kModels / "countries").string()), {country}));
  };
  const std::vector<Reading> right = of("es").read(image);
  ASSERT_EQ(right.size(), 1U);
  EXPECT_EQ(right[0].unfit, "");
  EXPECT_FALSE(reading_json(right[0]).contains("unfit"));
  const std::vector<Reading> wrong = of("br").read(image);
  ASSERT_EQ(wrong.size(), 1U);
  EXPECT_EQ(wrong[0].unfit, "4725BKZ");
  EXPECT_LT(wrong[0].confidence, 0.1);
  EXPECT_EQ(reading_json(wrong[0])["unfit"], "4725BKZ");
  EXPECT_EQ(recognizer().read(image).at(0).unfit, "");
}

TEST_F(RecognizerTest, JsonHasTheDocumentedFields) {
  cv::Mat image = gray_wall({640, 480});
  draw_plate(image, "4725BKZ", {200, 200}, 200);
  const nlohmann::ordered_json json = reading_json(recognizer().read(image).at(0));
  EXPECT_EQ(json["box"].size(), 4U);
  EXPECT_EQ(json["corners"].size(), 4U);
  EXPECT_EQ(json["candidates"][0]["text"], json["text"]);
  EXPECT_EQ(json["characters"].size(), 7U);
  double sum = 0;
  for (const auto& candidate : json["candidates"]) sum += candidate["confidence"].get<double>();
  EXPECT_LE(sum, 1.01);
}

TEST(Recognizer, ReturnsNoneForImagesWithoutPlates) {
  for (const cv::Size size : {cv::Size{1, 1}, cv::Size{3, 700}, cv::Size{640, 480}}) {
    EXPECT_TRUE(recognizer().read(cv::Mat(size, CV_8UC3, cv::Scalar(127, 127, 127))).empty())
        << size;
  }
}

TEST(Recognizer, RejectsUnsupportedImages) {
  EXPECT_THROW((void)recognizer().read(cv::Mat()), std::invalid_argument);
  EXPECT_THROW((void)recognizer().read(cv::Mat(10, 10, CV_32FC1)), std::invalid_argument);
}

class PlateModelFile : public FolderTest {};

TEST_F(PlateModelFile, RoundTripsByteForByte) {
  const auto text = [](const std::string& file) {
    std::ifstream stream(file);
    return std::string((std::istreambuf_iterator<char>(stream)), {});
  };
  const std::string reader = kModels / "plate-reader.json";
  write_reader_model(path("r.json"), read_reader_model(reader),
                     read_any_archive(reader).provenance);
  EXPECT_TRUE(text(path("r.json")) == text(reader));
  const std::string detector = kModels / "plate-detector.json";
  write_detector_model(path("d.json"), read_detector_model(detector),
                       read_any_archive(detector).provenance);
  EXPECT_TRUE(text(path("d.json")) == text(detector));
}

class BrokenModel : public FolderTest {};

TEST_F(BrokenModel, ErrorNamesThePath) {
  const std::string path = folder_ + "/m.json";
  const auto reason = [&](const std::string& text) -> std::string {
    std::ofstream(path) << text;
    try {
      (void)read_reader_model(path);
      return "read";
    } catch (const ModelError& error) {
      return error.what();
    }
  };
  EXPECT_THAT(reason(""), HasSubstr("m.json"));
  EXPECT_THAT(reason(std::string(100'000, '[')), HasSubstr("m.json"));
  EXPECT_THAT(reason(R"({"type":"plate-reader","version":1,"provenance":{},"payload":{}})"),
              HasSubstr("line"));
  std::ifstream shipped(kModels / "plate-reader.json");
  std::string whole((std::istreambuf_iterator<char>(shipped)), {});
  EXPECT_THAT(reason(whole.substr(0, whole.size() / 2)), HasSubstr("m.json"));
  EXPECT_THROW((void)read_detector_model((kModels / "plate-reader.json").string()), ModelError);
}

TEST(Calibration, FeaturesStayFinite) {
  for (const double p : {0.0, 1.0, 0.5}) {
    for (const double value : calibration_features(p, p, p, p * 100))
      EXPECT_TRUE(std::isfinite(value));
  }
}

}  // namespace
}  // namespace tarsier::plate
