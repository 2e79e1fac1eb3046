// SPDX-License-Identifier: MIT
#include "tarsier/synth/glyphs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/synth/plates.h"
#include "tarsier/synth/stroke_typeface.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <filesystem>
#include <ft2build.h>
#include <memory>
#include FT_FREETYPE_H

namespace tarsier::synth {
namespace {

// Typefaces similar to plate lettering, at the paths of Debian's packages.
constexpr const char* kFiles[] = {
    "/usr/share/fonts/truetype/opendin/OSP-DIN.ttf",
    "/usr/share/fonts/opentype/urw-base35/NimbusSansNarrow-Bold.otf",
    "/usr/share/fonts/opentype/urw-base35/NimbusSans-Bold.otf",
    "/usr/share/fonts/truetype/freefont/FreeSansBold.ttf",
    "/usr/share/fonts/truetype/roadgeek/RG2014B.ttf",
    "/usr/share/fonts/truetype/roadgeek/RG2014C.ttf",
    "/usr/share/fonts/truetype/roadgeek/RG2014D.ttf",
    "/usr/share/fonts/truetype/roadgeek/RG2014E.ttf",
    "/usr/share/fonts/truetype/dejavu/DejaVuSansCondensed-Bold.ttf",
    "/usr/share/fonts/truetype/dejavu/DejaVuSans-Bold.ttf",
    "/usr/share/fonts/truetype/dejavu/DejaVuSansMono-Bold.ttf",
    "/usr/share/fonts/truetype/freefont/FreeMonoBold.ttf",
};

// More typefaces of road signs, technical lettering, print and screens, with their packages.
constexpr const char* kMoreFiles[] = {
    "/usr/share/fonts/truetype/roadgeek/RG2014EM.ttf",
    "/usr/share/fonts/truetype/roadgeek/RG2014F.ttf",
    "/usr/share/fonts/opentype/urw-base35/URWGothic-Demi.otf",
    "/usr/share/fonts/opentype/urw-base35/NimbusMonoPS-Bold.otf",
    "/usr/share/fonts/opentype/urw-base35/NimbusSansNarrow-Regular.otf",
    "/usr/share/fonts/truetype/freefont/FreeSans.ttf",
    "/usr/share/fonts/truetype/dejavu/DejaVuSerifCondensed-Bold.ttf",
    // fonts-national-park, fonts-routed-gothic, fonts-bebas-neue, fonts-osifont, fonts-ocr-b
    "/usr/share/fonts/opentype/national-park/NationalPark-Heavy.otf",
    "/usr/share/fonts/opentype/national-park/NationalPark-Regular.otf",
    "/usr/share/fonts/truetype/routed-gothic/routed-gothic.ttf",
    "/usr/share/fonts/truetype/routed-gothic/routed-gothic-narrow.ttf",
    "/usr/share/fonts/opentype/bebas-neue/BebasNeue-Bold.otf",
    "/usr/share/fonts/opentype/bebas-neue/BebasNeue-Regular.otf",
    "/usr/share/fonts/truetype/osifont/osifont.ttf",
    "/usr/share/fonts/opentype/ocr-b/OCRB.otf",
    // fonts-roboto-unhinted, fonts-open-sans, fonts-b612, fonts-liberation, fonts-allerta
    "/usr/share/fonts/truetype/roboto/unhinted/RobotoCondensed-Bold.ttf",
    "/usr/share/fonts/truetype/roboto/unhinted/RobotoTTF/Roboto-Medium.ttf",
    "/usr/share/fonts/truetype/open-sans/OpenSans-CondBold.ttf",
    "/usr/share/fonts/opentype/b612/B612-Bold.otf",
    "/usr/share/fonts/opentype/b612/B612Mono-Bold.otf",
    "/usr/share/fonts/truetype/liberation/LiberationMono-Bold.ttf",
    "/usr/share/fonts/opentype/allerta/allerta_medium.otf",
    "/usr/share/fonts/opentype/allerta/allerta_stencil.otf",
    // fonts-tuffy, fonts-adf-universalis, fonts-adf-gillius, fonts-dosis
    "/usr/share/fonts/truetype/tuffy/Tuffy_Bold.ttf",
    "/usr/share/fonts/truetype/adf/UniversalisADFStd-BoldCond.otf",
    "/usr/share/fonts/truetype/adf/GilliusADF-BoldCond.otf",
    "/usr/share/fonts/opentype/dosis/Dosis-Bold.otf",
};

struct Library {
  FT_Library handle = nullptr;
  Library() {
    if (FT_Init_FreeType(&handle) != 0) handle = nullptr;
  }
  ~Library() {
    if (handle != nullptr) FT_Done_FreeType(handle);
  }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;
};

cv::Mat cut_to_ink(const cv::Mat& mask) {
  const cv::Rect box = cv::boundingRect(mask > 60);
  return box.empty() ? cv::Mat() : mask(box).clone();
}

// The same shape with thinner or heavier strokes: the outline moves by `px`.
cv::Mat reweighted(const cv::Mat& mask, int px) {
  const int border = std::max(0, px) + 1;
  cv::Mat wide;
  cv::copyMakeBorder(mask, wide, border, border, border, border, cv::BORDER_CONSTANT,
                     cv::Scalar(0));
  const int size = 2 * std::abs(px) + 1;
  const cv::Mat disk = cv::getStructuringElement(cv::MORPH_ELLIPSE, {size, size});
  if (px > 0)
    cv::dilate(wide, wide, disk);
  else
    cv::erode(wide, wide, disk);
  return cut_to_ink(wide);
}

bool load(FT_Library library, const char* path, GlyphSet::Typeface& typeface) {
  FT_Face face = nullptr;
  if (FT_New_Face(library, path, 0, &face) != 0) return false;
  const std::unique_ptr<FT_FaceRec, FT_Error (*)(FT_Face)> owner(face, &FT_Done_Face);
  typeface.name = std::filesystem::path(path).stem().string();
  // The size at which a capital letter has the required height.
  if (FT_Set_Pixel_Sizes(face, 0, 200) != 0 ||
      FT_Load_Char(face, 'H', FT_LOAD_RENDER | FT_LOAD_NO_HINTING) != 0 ||
      face->glyph->bitmap.rows == 0) {
    return false;
  }
  const auto size = static_cast<FT_UInt>(200.0 * GlyphSet::kCapHeight / face->glyph->bitmap.rows);
  if (FT_Set_Pixel_Sizes(face, 0, size) != 0) return false;
  int widest = 1;
  for (std::size_t i = 0; i < kPlateSymbols.size(); ++i) {
    if (FT_Load_Char(face, static_cast<FT_ULong>(kPlateSymbols[i]),
                     FT_LOAD_RENDER | FT_LOAD_NO_HINTING) != 0) {
      return false;
    }
    const FT_Bitmap& bitmap = face->glyph->bitmap;
    if (bitmap.rows == 0 || bitmap.width == 0 || bitmap.pitch < 0) return false;
    const cv::Mat mask(static_cast<int>(bitmap.rows), static_cast<int>(bitmap.width), CV_8UC1,
                       bitmap.buffer, static_cast<std::size_t>(bitmap.pitch));
    const cv::Mat ink = cut_to_ink(mask);
    if (ink.empty()) return false;
    typeface.masks[i] = ink;
    if (i < 10) widest = std::max(widest, ink.cols);
  }
  typeface.digit_aspect = static_cast<double>(widest) / GlyphSet::kCapHeight;
  return true;
}

template <std::size_t N>
std::vector<GlyphSet::Typeface> load_all(const char* const (&files)[N]) {
  const Library library;
  std::vector<GlyphSet::Typeface> typefaces;
  if (library.handle == nullptr) return typefaces;
  for (const char* path : files) {
    GlyphSet::Typeface typeface;
    std::error_code error;
    if (std::filesystem::exists(path, error) && load(library.handle, path, typeface))
      typefaces.push_back(std::move(typeface));
  }
  return typefaces;
}

std::vector<GlyphSet::Typeface> load_installed() {
  std::vector<GlyphSet::Typeface> typefaces = load_all(kFiles);
  if (typefaces.size() < 2) {
    throw InputError("typefaces",
                     "too few typefaces for plates are installed: apt-get install fonts-opendin "
                     "fonts-urw-base35 fonts-freefont-ttf fonts-roadgeek fonts-dejavu-extra");
  }
  return typefaces;
}

std::vector<GlyphSet::Typeface> draw(std::uint64_t seed, int count) {
  TARSIER_REQUIRE(count >= 1 && count <= 10000, "{} typefaces", count);
  std::vector<GlyphSet::Typeface> typefaces;
  for (int i = 0; i < count; ++i) {
    Rng rng = Rng(seed).fork(static_cast<std::uint64_t>(i));
    typefaces.push_back(stroke_typeface("drawn " + std::to_string(i), rng));
  }
  return typefaces;
}

}  // namespace

GlyphSet::GlyphSet(std::vector<Typeface> typefaces)
    : typefaces_(std::move(typefaces)),
      reweighted_(
          std::make_unique<Reweighted[]>(typefaces_.size() * kWeights * kPlateSymbols.size())) {
  for (std::size_t i = 0; i < typefaces_.size(); ++i)
    shared_.insert(shared_.end(), static_cast<std::size_t>(std::max(0, typefaces_[i].share)),
                   static_cast<int>(i));
}

const cv::Mat& GlyphSet::mask(int typeface, int weight, std::size_t symbol) const {
  TARSIER_REQUIRE(weight >= 0 && weight < kWeights && symbol < kPlateSymbols.size(),
                  "weight {} of symbol {}", weight, symbol);
  const auto number = static_cast<std::size_t>(typeface);
  const Typeface& face = typefaces_.at(number);
  const cv::Mat& own = face.masks[symbol];
  constexpr int kMoves[kWeights] = {-3, -1, 0, 2, 4};  // px
  const int px = kMoves[weight];
  if (px == 0 || !face.has_weights) return own;
  Reweighted& other =
      reweighted_[(number * kWeights + static_cast<std::size_t>(weight)) * kPlateSymbols.size() +
                  symbol];
  std::call_once(other.once, [&] {
    const cv::Mat moved = reweighted(own, px);
    other.mask = moved.empty() ? own : moved;
  });
  return other.mask;
}

int GlyphSet::pick(Rng& rng) const {
  TARSIER_REQUIRE(!shared_.empty(), "there are no typefaces");
  return shared_[static_cast<std::size_t>(rng.integer(0, static_cast<int>(shared_.size()) - 1))];
}

std::shared_ptr<const GlyphSet> load_glyphs() {
  return std::make_shared<const GlyphSet>(load_installed());
}

std::shared_ptr<const GlyphSet> load_many_glyphs(std::uint64_t seed, int drawn) {
  // Shares of ten: three, two, five.
  constexpr double kPicks = 10000;
  std::vector<GlyphSet::Typeface> typefaces;
  const auto add = [&](std::vector<GlyphSet::Typeface> some, double tenths) {
    for (GlyphSet::Typeface& typeface : some) {
      typeface.share =
          std::max(1, cvRound(kPicks * tenths / 10 / static_cast<double>(some.size())));
      typefaces.push_back(std::move(typeface));
    }
  };
  add(load_installed(), 3);
  add(load_all(kMoreFiles), 2);
  add(draw(seed, drawn), 5);
  return std::make_shared<const GlyphSet>(std::move(typefaces));
}

std::shared_ptr<const GlyphSet> draw_glyphs(std::uint64_t seed, int drawn) {
  return std::make_shared<const GlyphSet>(draw(seed, drawn));
}

}  // namespace tarsier::synth
