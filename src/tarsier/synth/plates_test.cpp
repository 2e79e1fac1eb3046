// SPDX-License-Identifier: MIT
#include "tarsier/synth/plates.h"

#include "tarsier/core/errors.h"
#include "tarsier/synth/glyphs.h"
#include "tarsier/synth/plate_painter.h"
#include "tarsier/synth/plate_texts.h"
#include "tarsier/synth/street.h"
#include "tarsier/synth/testing_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

namespace tarsier::synth {
namespace {

constexpr PlateKind kKinds[] = {
    PlateKind::kSpain,  PlateKind::kSpainOld, PlateKind::kSpainSquare, PlateKind::kSpainMoto,
    PlateKind::kEurope, PlateKind::kUs,       PlateKind::kBrazil};

class DrawnPlates : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    try {
      glyphs_ = load_glyphs();
    } catch (const InputError&) {
    }
  }
  void SetUp() override {
    if (glyphs_ == nullptr) GTEST_SKIP() << "no typefaces to draw plates with";
  }
  static std::shared_ptr<const GlyphSet> glyphs_;
};
std::shared_ptr<const GlyphSet> DrawnPlates::glyphs_;

TEST(PlateTexts, MatchFormatsOfTheirCountry) {
  const std::map<PlateKind, std::string> forms{
      {PlateKind::kSpain, "[0-9]{4} [BCDFGHJKLMNPRSTVWXYZ]{3}"},
      {PlateKind::kBrazil, "[A-Z]{3} [0-9]{4}|[A-Z]{3} ?[0-9][A-Z][0-9]{2}"},
  };
  Rng rng(3);
  for (const auto& [kind, form] : forms) {
    for (int i = 0; i < 50; ++i) {
      const std::vector<std::string> rows = plate_text(kind, "", false, rng);
      ASSERT_EQ(rows.size(), 1U);
      EXPECT_THAT(rows[0], testing::MatchesRegex(form));
    }
  }
  EXPECT_EQ(plate_text(PlateKind::kSpainSquare, "1234BCD", false, rng).size(), 2U);
  EXPECT_THROW((void)plate_text(PlateKind::kSpain, "12?4", false, rng), std::invalid_argument);
}

TEST_F(DrawnPlates, HaveExpectedSizeAndOrderedSymbols) {
  for (const PlateKind kind : kKinds) {
    Rng rng(11);
    for (int i = 0; i < 10; ++i) {
      PlateFaceOptions options;
      options.kind = kind;
      options.px_per_mm = 1.0F;
      const PlateFace face = render_plate_face(*glyphs_, options, rng);
      ASSERT_EQ(face.image.type(), CV_8UC3);
      ASSERT_EQ(face.symbols.size(), face.text.size());
      for (std::size_t k = 0; k < face.symbols.size(); ++k) {
        const PlateSymbol& symbol = face.symbols[k];
        EXPECT_EQ(symbol.symbol, face.text[k]);
        EXPECT_LT(symbol.row, face.rows);
        EXPECT_GE(symbol.box.x, 0);
        EXPECT_LE(symbol.box.x + symbol.box.width, static_cast<float>(face.image.cols) + 1);
        if (k > 0 && symbol.row == face.symbols[k - 1].row) {
          EXPECT_GT(symbol.box.x, face.symbols[k - 1].box.x);
        }
      }
    }
  }
}

TEST_F(DrawnPlates, SpanishPlateHasLegalGeometry) {
  PlateFaceOptions options;
  options.text = "8246DFG";
  options.random_style = false;
  options.px_per_mm = 2;
  Rng rng(1);
  const PlateFace face = render_plate_face(*glyphs_, options, rng);
  EXPECT_EQ(face.image.size(), cv::Size(1040, 220));
  for (const PlateSymbol& symbol : face.symbols)
    EXPECT_NEAR(symbol.box.height, 154, 8) << symbol.symbol;  // 77 mm
  // The space between groups is wider than the gaps within groups.
  const auto gap = [&](std::size_t k) {
    return face.symbols[k + 1].box.x - face.symbols[k].box.x - face.symbols[k].box.width;
  };
  EXPECT_GT(gap(3), 2 * gap(1));
  // Blue band at the left, dark ink on white.
  const cv::Vec3b band = face.image.at<cv::Vec3b>(200, 12);
  EXPECT_GT(band[0], band[2] + 50);
  const cv::Rect ink = face.symbols[0].box;
  cv::Mat gray;
  cv::cvtColor(face.image, gray, cv::COLOR_BGR2GRAY);
  double least = 0;
  double most = 0;
  cv::minMaxLoc(gray(ink), &least, &most);
  EXPECT_LT(least, 60);
  EXPECT_GT(most, 190);
}

TEST_F(DrawnPlates, DependOnSeed) {
  PlateFaceOptions options;
  options.kind = PlateKind::kEurope;
  Rng first(5);
  Rng again(5);
  Rng other(6);
  const PlateFace face = render_plate_face(*glyphs_, options, first);
  const PlateFace same = render_plate_face(*glyphs_, options, again);
  EXPECT_EQ(face.text, same.text);
  EXPECT_TRUE(is_same(face.image, same.image));
  EXPECT_NE(face.text, render_plate_face(*glyphs_, options, other).text);
}

TEST_F(DrawnPlates, InfraredOnesAreGreyAndBright) {
  PlateFaceOptions options;
  options.infrared = true;
  Rng rng(2);
  const PlateFace face = render_plate_face(*glyphs_, options, rng);
  std::vector<cv::Mat> channels;
  cv::split(face.image, channels);
  EXPECT_EQ(cv::norm(channels[0], channels[2], cv::NORM_INF), 0);
  EXPECT_GT(cv::mean(channels[0])[0], 110);
}

TEST(StrokeTypefaces, HaveDistinctSymbolsOfCapHeight) {
  const auto glyphs = draw_glyphs(3, 25);
  ASSERT_EQ(glyphs->typefaces().size(), 25U);
  const auto shape_of = [](const cv::Mat& mask) {
    cv::Mat small;
    cv::resize(mask, small, {24, 32}, 0, 0, cv::INTER_AREA);
    return small;
  };
  const std::set<std::string> alike{"0O", "1I", "0D", "DO", "OQ", "0Q", "8B", "VY", "UV"};
  for (const GlyphSet::Typeface& typeface : glyphs->typefaces()) {
    for (std::size_t i = 0; i < kPlateSymbols.size(); ++i) {
      const cv::Mat& mask = typeface.masks[i];
      EXPECT_NEAR(mask.rows, GlyphSet::kCapHeight, 12) << kPlateSymbols[i];
      EXPECT_GT(cv::countNonZero(mask > 127), mask.total() / 6) << kPlateSymbols[i];
      for (std::size_t k = i + 1; k < kPlateSymbols.size(); ++k) {
        if (alike.contains({kPlateSymbols[i], kPlateSymbols[k]})) continue;
        EXPECT_GT(cv::norm(shape_of(mask), shape_of(typeface.masks[k]), cv::NORM_L1),
                  24 * 32 * 255 * 0.025)
            << typeface.name << ": " << kPlateSymbols[i] << kPlateSymbols[k];
      }
    }
  }
}

TEST(StrokeTypefaces, DependOnSeed) {
  const auto one = draw_glyphs(5, 2);
  const auto same = draw_glyphs(5, 2);
  const auto other = draw_glyphs(6, 2);
  const auto five = [](const auto& glyphs) { return glyphs->typefaces()[1].masks[5]; };
  EXPECT_TRUE(is_same(five(one), five(same)));
  EXPECT_FALSE(is_same(five(one), five(other)));
}

TEST(StrokeTypefaces, RenderWildPlatesWithCorrectTruth) {
  const auto glyphs = draw_glyphs(1, 10);
  Rng rng(4);
  for (int i = 0; i < 60; ++i) {
    PlateFaceOptions options;
    options.kind = kKinds[i % 7];
    options.wild = true;
    const PlateFace face = render_plate_face(*glyphs, options, rng);
    ASSERT_EQ(face.symbols.size(), face.text.size());
    for (const PlateSymbol& symbol : face.symbols) {
      EXPECT_GE(symbol.box.x, -1);  // slanted letters may reach over the edge
      EXPECT_LT(symbol.box.x + symbol.box.width, static_cast<float>(face.image.cols) + 20);
      EXPECT_GT(symbol.box.width, 2);
    }
  }
}

class StreetDrives : public DrawnPlates {
 protected:
  static StreetOptions small_drive() {
    StreetOptions options;
    options.size = {640, 360};
    options.seconds = 12;
    options.cars = 3;
    options.seed = 9;
    return options;
  }
};

TEST_F(StreetDrives, TruthMatchesDrawnPlate) {
  StreetOptions options;
  options.seed = 4;
  for (std::uint64_t number = 0; number < 6; ++number) {
    const StreetImage image = render_car(options, number);
    ASSERT_EQ(image.image.size(), options.size);
    for (const StreetPlate& plate : image.plates) {
      if (!plate.visible) continue;
      cv::Mat face;
      const std::vector<cv::Point2f> corners(plate.corners.begin(), plate.corners.end());
      const std::vector<cv::Point2f> to{{0, 0}, {208, 0}, {208, 44}, {0, 44}};
      cv::warpPerspective(image.image, face, cv::getPerspectiveTransform(corners, to), {208, 44},
                          cv::INTER_AREA);
      cv::cvtColor(face, face, cv::COLOR_BGR2GRAY);
      cv::Scalar mean;
      cv::Scalar deviation;
      cv::meanStdDev(face, mean, deviation);
      EXPECT_GT(deviation[0], 12) << number;  // dark ink on a bright ground
    }
  }
}

TEST_F(StreetDrives, DriveShowsEveryCarAndKeepsParkedOne) {
  const Drive drive(small_drive());
  const std::vector<std::string> texts = drive.texts();
  ASSERT_EQ(texts.size(), 3U);
  EXPECT_EQ(std::set<std::string>(texts.begin(), texts.end()).size(), 3U);
  std::map<int, int> seen;
  constexpr int kFrames = 48;
  for (int i = 0; i < kFrames; ++i)
    for (const StreetPlate& plate : drive.at(i * 12.0 / kFrames).plates)
      seen[plate.id] += plate.visible;
  ASSERT_EQ(seen.size(), 3U);
  int longest = 0;
  for (const auto& [id, count] : seen) {
    EXPECT_GT(count, 2) << id;
    longest = std::max(longest, count);
  }
  EXPECT_GT(longest, kFrames / 2);
}

TEST_F(StreetDrives, DependOnTimeAndSeed) {
  const Drive drive(small_drive());
  EXPECT_TRUE(is_same(drive.at(3.5).image, Drive(small_drive()).at(3.5).image));
  StreetOptions other = small_drive();
  other.seed = 10;
  EXPECT_NE(drive.texts(), Drive(other).texts());
}

TEST_F(StreetDrives, InfraredIsGreyAndDarkAroundThePlate) {
  StreetOptions options = small_drive();
  options.light = StreetLight::kInfrared;
  const StreetImage image = render_car(options, 1);
  std::vector<cv::Mat> channels;
  cv::split(image.image, channels);
  EXPECT_EQ(cv::norm(channels[0], channels[2], cv::NORM_INF), 0);
  EXPECT_LT(cv::mean(channels[0])[0], 80);
}

TEST_F(StreetDrives, RejectInvalidOptions) {
  StreetOptions options;
  options.cars = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.parked = 7;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.seconds = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

std::shared_ptr<const GlyphSet> known_glyphs() {
  static const std::shared_ptr<const GlyphSet> glyphs = load_glyphs();
  return glyphs;
}

// A plain image that a painter draws on, and measures of the changes.
struct Painted {
  cv::Mat image{200, 600, CV_8UC3, cv::Scalar::all(250)};
  std::shared_ptr<const GlyphSet> glyphs = known_glyphs();
  Rng rng;
  PlateStyle style;

  explicit Painted(std::uint64_t seed) : rng(seed) {}
  [[nodiscard]] PlatePainter painter() { return {image, 1.0, *glyphs, rng}; }
  [[nodiscard]] cv::Rect changed() const {
    cv::Mat gray;
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
    return cv::boundingRect(gray != 250);
  }
  [[nodiscard]] double strongest() const {
    return cv::norm(image, cv::Mat(image.size(), CV_8UC3, cv::Scalar::all(250)), cv::NORM_INF);
  }
};

TEST(PlateOrnaments, CrestsStayWithinTheirRadius) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Painted painted(seed);
    crest(painted.painter(), painted.style, 300, 100, 30);
    const cv::Rect where = painted.changed();
    EXPECT_GT(where.area(), 400) << seed;
    EXPECT_EQ(where & cv::Rect(262, 62, 77, 77), where) << seed;
  }
}

TEST(PlateOrnaments, GhostsAreFainterThanCrests) {
  double most = 0;
  double ghosts = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Painted faded(seed);
    ghost(faded.painter(), faded.style, 300, 100);
    ghosts = std::max(ghosts, faded.strongest());
    Painted full(seed);
    crest(full.painter(), full.style, 300, 100, 30);
    most = std::max(most, full.strongest());
  }
  EXPECT_GT(ghosts, 20);
  EXPECT_LE(ghosts, 0.6 * 250 + 1);
  EXPECT_GT(most, 200);
}

TEST(PlateOrnaments, SideSymbolsStartOrEndAtGivenPosition) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    for (const bool ends : {false, true}) {
      Painted painted(seed);
      const double width = side_symbols(painted.painter(), painted.style, 300, 100, ends);
      const cv::Rect where = painted.changed();
      EXPECT_GT(where.height, 15) << seed;
      EXPECT_LT(where.height, 0.7 * painted.style.cap_height) << seed;
      const double middle = where.x + where.width / 2.0;
      EXPECT_EQ(middle < 300, ends) << seed;
      EXPECT_LT(std::abs(middle - 300), width) << seed;
    }
  }
}

}  // namespace
}  // namespace tarsier::synth
