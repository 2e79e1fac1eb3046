// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/exif.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

// Writes TIFF directories for the parser.
class TiffWriter {
 public:
  explicit TiffWriter(bool is_little_endian) : is_little_endian_(is_little_endian) {}

  void put(std::uint32_t value, int size) {
    for (int k = 0; k < size; ++k)
      bytes += static_cast<char>(value >> (8 * (is_little_endian_ ? k : size - 1 - k)));
  }
  [[nodiscard]] std::string values(const std::vector<std::uint32_t>& numbers, int size) const {
    TiffWriter writer(is_little_endian_);
    for (const std::uint32_t number : numbers) writer.put(number, size);
    return writer.bytes;
  }

  struct Field {
    std::uint32_t tag;
    std::uint32_t type;
    std::uint32_t count;
    std::string data;
  };
  [[nodiscard]] Field ascii(std::uint32_t tag, const std::string& text) const {
    return {tag, 2, static_cast<std::uint32_t>(text.size() + 1), text + '\0'};
  }
  [[nodiscard]] Field shorts(std::uint32_t tag, std::uint32_t value) const {
    return {tag, 3, 1, values({value}, 2)};
  }
  [[nodiscard]] Field longs(std::uint32_t tag, std::uint32_t value) const {
    return {tag, 4, 1, values({value}, 4)};
  }
  [[nodiscard]] Field rationals(std::uint32_t tag, const std::vector<std::uint32_t>& parts) const {
    return {tag, 5, static_cast<std::uint32_t>(parts.size() / 2), values(parts, 4)};
  }

  void directory(const std::vector<Field>& fields) {
    put(static_cast<std::uint32_t>(fields.size()), 2);
    std::size_t offset = bytes.size() + 12 * fields.size() + 4;
    std::string behind;
    for (const Field& field : fields) {
      put(field.tag, 2);
      put(field.type, 2);
      put(field.count, 4);
      if (field.data.size() <= 4) {
        bytes += field.data + std::string(4 - field.data.size(), '\0');
      } else {
        put(static_cast<std::uint32_t>(offset + behind.size()), 4);
        behind += field.data;
      }
    }
    put(0, 4);
    bytes += behind;
  }

  std::string bytes;

 private:
  bool is_little_endian_;
};

struct Content {
  std::uint32_t orientation = 6;
  std::uint32_t focal_35mm = 28;
  std::uint32_t unit = 2;
  std::vector<std::uint32_t> focal{49, 10};
  std::vector<std::uint32_t> resolution{254000, 10};
  std::vector<std::uint32_t> latitude{43, 1, 53, 1, 3346, 100};
  std::vector<std::uint32_t> longitude{103, 1, 25, 1, 3303, 100};
  std::string latitude_ref = "N";
  std::string longitude_ref = "W";
  std::string status = "A";
  std::uint32_t below = 0;
  std::string model = "DMC-TS3";
};

std::string jpeg_with(const std::string& tiff) {
  const std::string segment = std::string("Exif\0\0", 6) + tiff;
  const std::size_t length = segment.size() + 2;
  std::string jpeg = "\xFF\xD8\xFF\xE0";
  jpeg += std::string("\0\4JF", 4);
  jpeg += "\xFF\xFF\xE1";  // with a fill byte
  jpeg += static_cast<char>(length >> 8U);
  jpeg += static_cast<char>(length);
  return jpeg + segment + "\xFF\xD9";
}

std::string tiff_of(bool is_little_endian, const Content& content = {}) {
  const auto build = [&](std::uint32_t exif, std::uint32_t gps) {
    TiffWriter w(is_little_endian);
    w.bytes = is_little_endian ? "II" : "MM";
    w.put(42, 2);
    w.put(8, 4);
    w.directory({w.ascii(0x010F, "Panasonic "), w.ascii(0x0110, content.model),
                 w.shorts(0x0112, content.orientation), w.longs(0x8769, exif),
                 w.longs(0x8825, gps)});
    const std::size_t exif_offset = w.bytes.size();
    w.directory({w.rationals(0x920A, content.focal), w.longs(0xA002, 4000), w.shorts(0xA003, 3000),
                 w.rationals(0xA20E, content.resolution), w.shorts(0xA210, content.unit),
                 w.shorts(0xA405, content.focal_35mm)});
    const std::size_t gps_offset = w.bytes.size();
    w.directory({w.ascii(1, content.latitude_ref),
                 w.rationals(2, content.latitude),
                 w.ascii(3, content.longitude_ref),
                 w.rationals(4, content.longitude),
                 {5, 1, 1, std::string(1, static_cast<char>(content.below))},
                 w.rationals(6, {19530, 10}),
                 w.ascii(9, content.status)});
    return std::tuple(w.bytes, exif_offset, gps_offset);
  };
  const auto [ignored, exif, gps] = build(0, 0);
  return std::get<0>(build(static_cast<std::uint32_t>(exif), static_cast<std::uint32_t>(gps)));
}

Exif exif_of(const Content& content) { return parse_exif(jpeg_with(tiff_of(true, content))); }

TEST(Exif, IsReadInBothByteOrders) {
  for (const bool is_little_endian : {false, true}) {
    const Exif exif = parse_exif(jpeg_with(tiff_of(is_little_endian)));
    EXPECT_DOUBLE_EQ(exif.focal_mm, 4.9);
    EXPECT_EQ(exif.focal_35mm, 28);
    EXPECT_DOUBLE_EQ(exif.focal_plane_px_per_mm, 1000);
    EXPECT_EQ(exif.original_px, cv::Size(4000, 3000));
    EXPECT_EQ(exif.orientation, 6);
    EXPECT_EQ(exif.camera, "Panasonic DMC-TS3");
    ASSERT_TRUE(exif.gps);
    EXPECT_NEAR((*exif.gps)[0], 43 + 53 / 60.0 + 33.46 / 3600, 1e-9);
    EXPECT_NEAR((*exif.gps)[1], -(103 + 25 / 60.0 + 33.03 / 3600), 1e-9);
    EXPECT_NEAR((*exif.gps)[2], 1953, 1e-9);
  }
}

TEST(Exif, IgnoresImpossibleValues) {
  EXPECT_EQ(exif_of({.orientation = 9}).orientation, 1);
  EXPECT_EQ(exif_of({.focal = {49, 0}}).focal_mm, 0);
  EXPECT_EQ(exif_of({.unit = 1}).focal_plane_px_per_mm, 0);
  EXPECT_DOUBLE_EQ(exif_of({.unit = 3}).focal_plane_px_per_mm, 2540);
  EXPECT_EQ(exif_of({.resolution = {1, 0}}).focal_plane_px_per_mm, 0);
  EXPECT_FALSE(exif_of({.latitude = {0, 0, 0, 0, 0, 0}}).gps);
  EXPECT_FALSE(exif_of({.latitude = {91, 1, 0, 1, 0, 1}}).gps);
  EXPECT_FALSE(exif_of({.latitude = {43, 1, 61, 1, 0, 1}}).gps);
  EXPECT_FALSE(exif_of({.longitude = {181, 1, 0, 1, 0, 1}}).gps);
  EXPECT_FALSE(exif_of({.latitude_ref = "?"}).gps);
  EXPECT_FALSE(exif_of({.longitude_ref = ""}).gps);
  EXPECT_FALSE(exif_of({.status = "V"}).gps);
  EXPECT_FALSE(exif_of({.latitude = {0, 1}, .longitude = {0, 1}}).gps);
}

TEST(Exif, NormalisesCameraNamesAndSignsOfPositions) {
  EXPECT_EQ(exif_of({.model = "Panasonic X"}).camera, "Panasonic X");
  EXPECT_EQ(exif_of({.model = ""}).camera, "Panasonic");
  EXPECT_EQ(exif_of({.model = "\x01\xFFx"}).camera, "Panasonic ??x");
  const Exif south = exif_of({.latitude = {435, 10, 0, 0, 0, 0}, .latitude_ref = "S", .below = 1});
  ASSERT_TRUE(south.gps);
  EXPECT_DOUBLE_EQ((*south.gps)[0], -43.5);
  EXPECT_DOUBLE_EQ((*south.gps)[2], -1953);
}

TEST(Exif, IsEmptyForOtherBytes) {
  for (const std::string& bytes :
       {std::string(), std::string("\xFF\xD8"), std::string("\xFF\xD8\xFF\xD9"),
        std::string("GIF89a......"), std::string("\xFF\xD8\xFF\xE1\0\0", 6), jpeg_with(""),
        jpeg_with("II"), jpeg_with(std::string("II\x2B\0\x08\0\0\0", 8)),
        "\xFF\xD8\xFF\xDA" + jpeg_with(tiff_of(true)).substr(2)}) {
    const Exif exif = parse_exif(bytes);
    EXPECT_EQ(exif.focal_35mm, 0);
    EXPECT_EQ(exif.orientation, 1);
    EXPECT_FALSE(exif.gps);
  }
}

// A directory that refers to itself is read once as each of the three.
TEST(Exif, StopsAtCyclicDirectories) {
  TiffWriter w(true);
  w.bytes = "II";
  w.put(42, 2);
  w.put(8, 4);
  w.directory({w.shorts(0x0112, 3), w.longs(0x8769, 8), w.longs(0x8825, 8)});
  EXPECT_EQ(parse_exif(jpeg_with(w.bytes)).orientation, 3);
}

TEST(Exif, ReadsTruncatedFiles) {
  const std::string complete = jpeg_with(tiff_of(false));
  double known = 0;
  for (std::size_t size = 0; size <= complete.size(); ++size) {
    // A separate copy, so that a sanitizer detects every access outside.
    const std::vector<char> part(complete.begin(),
                                 complete.begin() + static_cast<std::ptrdiff_t>(size));
    const Exif exif = parse_exif({part.data(), part.size()});
    EXPECT_GE(exif.focal_35mm, known);
    known = exif.focal_35mm;
  }
  EXPECT_EQ(known, 28);
}

TEST(Exif, SurvivesMutations) {
  Rng rng(11);
  int readable = 0;
  for (int k = 0; k < 4000; ++k) {
    std::string bytes = jpeg_with(tiff_of(k % 2 == 0));
    for (int changes = rng.integer(1, 12); changes > 0; --changes) {
      const int offset = rng.integer(0, static_cast<int>(bytes.size()) - 1);
      const int value = rng.uniform() < 0.3 ? 255 * rng.integer(0, 1) : rng.integer(0, 255);
      bytes[static_cast<std::size_t>(offset)] = static_cast<char>(value);
    }
    if (rng.uniform() < 0.2)
      bytes.resize(static_cast<std::size_t>(rng.integer(0, static_cast<int>(bytes.size()))));
    const std::vector<char> copy(bytes.begin(), bytes.end());
    const Exif exif = parse_exif({copy.data(), copy.size()});
    EXPECT_TRUE(exif.orientation >= 1 && exif.orientation <= 8);
    EXPECT_TRUE(std::isfinite(exif.focal_mm) && exif.focal_mm >= 0);
    EXPECT_TRUE(std::isfinite(exif.focal_plane_px_per_mm) && exif.focal_plane_px_per_mm >= 0);
    const double focal = focal_px_of(exif, {1024, 768});
    EXPECT_TRUE(focal == 0 || (focal >= 102 && focal <= 20480));
    if (exif.gps) {
      EXPECT_LE(std::abs((*exif.gps)[0]), 90);
      EXPECT_LE(std::abs((*exif.gps)[1]), 180);
      EXPECT_LT(local_metres({*exif.gps})[0].norm(), 1e-6);
    }
    for (const char c : exif.camera) EXPECT_TRUE(c >= 0x20 && c < 0x7F);
    if (focal > 0) ++readable;
  }
  EXPECT_GT(readable, 1000);
}

TEST(FocalPx, ComesFrom35mmEquivalentOrSensorResolution) {
  Exif exif;
  EXPECT_EQ(focal_px_of(exif, {1024, 768}), 0);
  exif.focal_mm = 4.9;
  EXPECT_EQ(focal_px_of(exif, {1024, 768}), 0);
  exif.focal_plane_px_per_mm = 1000;
  EXPECT_DOUBLE_EQ(focal_px_of(exif, {4000, 3000}), 4900);
  exif.original_px = {4000, 3000};
  EXPECT_DOUBLE_EQ(focal_px_of(exif, {1000, 750}), 1225);
  EXPECT_DOUBLE_EQ(focal_px_of(exif, {750, 1000}), 1225);
  exif.focal_35mm = 28;
  EXPECT_DOUBLE_EQ(focal_px_of(exif, {1024, 768}), 28.0 / 36 * 1024);
  EXPECT_DOUBLE_EQ(focal_px_of(exif, {768, 1024}), 28.0 / 36 * 1024);
  exif.focal_35mm = 1e5;
  EXPECT_EQ(focal_px_of(exif, {1024, 768}), 0);
  EXPECT_THROW((void)focal_px_of(exif, {}), std::invalid_argument);
}

// Lengths of a degree at 45 N on WGS84: 111131.7 m of latitude (mean over the degree), 78846.8 m of
// longitude.
TEST(LocalMetres, AreEastNorthUp) {
  const std::vector<Eigen::Vector3d> metres = local_metres(
      {{45.001, 7, 100}, {44.999, 7, 100}, {45, 7.001, 100}, {45, 6.999, 100}, {45, 7, 120}});
  ASSERT_EQ(metres.size(), 5U);
  const Eigen::Vector3d north = metres[0] - metres[1];
  EXPECT_NEAR(north[1], 222.2634 * (1 + 100 / 6.37e6), 0.005);
  EXPECT_NEAR(north[0], 0, 1e-6);
  const Eigen::Vector3d east = metres[2] - metres[3];
  EXPECT_NEAR(east[0], 157.6936 * (1 + 100 / 6.38e6), 0.005);
  EXPECT_NEAR(east[1], 0, 1e-6);
  const Eigen::Vector3d up = metres[4] - 0.5 * (metres[2] + metres[3]);
  EXPECT_NEAR(up[2], 20, 0.005);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : metres) sum += x;
  EXPECT_LT(sum.norm(), 1e-6);
}

TEST(LocalMetres, CrossTheDateLineAndThePole) {
  const std::vector<Eigen::Vector3d> date = local_metres({{0, 179.9995, 0}, {0, -179.9995, 0}});
  EXPECT_NEAR(date[1][0] - date[0][0], 111.319, 0.01);
  const std::vector<Eigen::Vector3d> pole = local_metres({{89.999, 0, 0}, {89.999, 180, 0}});
  EXPECT_NEAR((pole[0] - pole[1]).norm(), 223.39, 0.01);
  EXPECT_NEAR(pole[0][2], pole[1][2], 1e-6);
  EXPECT_TRUE(local_metres({}).empty());
  EXPECT_THROW((void)local_metres({{91, 0, 0}}), std::invalid_argument);
  EXPECT_THROW((void)local_metres({{0, std::nan(""), 0}}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
