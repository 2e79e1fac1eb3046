// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/exif.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

namespace tarsier::sfm {
namespace {

constexpr std::string_view kExifStart("Exif\0\0", 6);
constexpr std::size_t kMaxText = 100;            // bytes of make or model
constexpr double kMaxSide = 1'000'000;           // px
constexpr double kDeg = std::numbers::pi / 180;  // rad

// Tags of IFD 0, of the Exif directory and of the GPS directory.
constexpr int kMake = 0x010F;
constexpr int kModel = 0x0110;
constexpr int kOrientation = 0x0112;
constexpr int kExifDirectory = 0x8769;
constexpr int kGpsDirectory = 0x8825;
constexpr int kFocalLength = 0x920A;
constexpr int kPixelXDimension = 0xA002;
constexpr int kPixelYDimension = 0xA003;
constexpr int kFocalPlaneXResolution = 0xA20E;
constexpr int kFocalPlaneResolutionUnit = 0xA210;
constexpr int kFocalLength35 = 0xA405;
constexpr int kLatitudeRef = 1;
constexpr int kLatitude = 2;
constexpr int kLongitudeRef = 3;
constexpr int kLongitude = 4;
constexpr int kAltitudeRef = 5;
constexpr int kAltitude = 6;
constexpr int kGpsStatus = 9;

// Bytes of a value of the TIFF types 1..12; 0: unknown type.
std::size_t bytes_of_type(std::uint32_t type) {
  constexpr std::array<std::size_t, 13> kBytes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8};
  return type < kBytes.size() ? kBytes[type] : 0;
}

struct Entry {
  std::uint32_t type = 0;
  std::size_t count = 0;
  std::size_t offset = 0;  // offset of its values, all of them inside the bytes
};

// Reads TIFF numbers; bytes outside the data read as 0.
class Tiff {
 public:
  Tiff(std::string_view bytes, bool is_little_endian)
      : bytes_(bytes), is_little_endian_(is_little_endian) {}

  [[nodiscard]] std::uint32_t integer(std::size_t offset, std::size_t size) const {
    if (!is_inside(offset, size)) return 0;
    std::uint32_t value = 0;
    for (std::size_t k = 0; k < size; ++k) {
      const auto byte =
          static_cast<unsigned char>(bytes_[offset + (is_little_endian_ ? size - 1 - k : k)]);
      value = value << 8U | byte;
    }
    return value;
  }

  // An entry of the directory at `directory`. Directories are scanned for each tag and never
  // followed automatically, so cyclic directories are harmless.
  [[nodiscard]] std::optional<Entry> find(std::size_t directory, int tag) const {
    if (directory == 0 || !is_inside(directory, 2)) return std::nullopt;
    const std::size_t entries = integer(directory, 2);
    for (std::size_t k = 0; k < entries; ++k) {
      const std::size_t offset = directory + 2 + 12 * k;
      if (!is_inside(offset, 12)) return std::nullopt;
      if (integer(offset, 2) != static_cast<std::uint32_t>(tag)) continue;
      Entry entry{integer(offset + 2, 2), integer(offset + 4, 4), offset + 8};
      const std::size_t size = bytes_of_type(entry.type);
      if (size == 0 || entry.count == 0 || entry.count > bytes_.size()) return std::nullopt;
      if (size * entry.count > 4) entry.offset = integer(offset + 8, 4);
      if (!is_inside(entry.offset, size * entry.count)) return std::nullopt;
      return entry;
    }
    return std::nullopt;
  }

  // The value at `index`; empty where it does not exist or its denominator is 0.
  [[nodiscard]] std::optional<double> number(const std::optional<Entry>& entry,
                                             std::size_t index = 0) const {
    if (!entry || index >= entry->count) return std::nullopt;
    const std::size_t size = bytes_of_type(entry->type);
    const std::size_t offset = entry->offset + index * size;
    const std::uint32_t first = integer(offset, std::min<std::size_t>(size, 4));
    switch (entry->type) {
      case 1:  // BYTE
      case 3:  // SHORT
      case 4:  // LONG
        return first;
      case 5: {  // RATIONAL
        const std::uint32_t second = integer(offset + 4, 4);
        if (second == 0) return std::nullopt;
        return static_cast<double>(first) / second;
      }
      case 9:  // SLONG
        return std::bit_cast<std::int32_t>(first);
      case 10: {  // SRATIONAL
        const auto second = std::bit_cast<std::int32_t>(integer(offset + 4, 4));
        if (second == 0) return std::nullopt;
        return static_cast<double>(std::bit_cast<std::int32_t>(first)) / second;
      }
      default:
        return std::nullopt;
    }
  }

  // A number in [low, high], or else `otherwise`.
  [[nodiscard]] double number_in(std::size_t directory, int tag, double low, double high,
                                 double otherwise) const {
    const std::optional<double> value = number(find(directory, tag));
    return value && *value >= low && *value <= high ? *value : otherwise;
  }

  // ASCII up to the first zero, trimmed; other characters become '?'.
  [[nodiscard]] std::string text(std::size_t directory, int tag) const {
    const std::optional<Entry> entry = find(directory, tag);
    if (!entry || entry->type != 2) return {};
    std::string_view raw = bytes_.substr(entry->offset, std::min(entry->count, kMaxText));
    raw = raw.substr(0, raw.find('\0'));
    while (!raw.empty() && raw.front() == ' ') raw.remove_prefix(1);
    while (!raw.empty() && raw.back() == ' ') raw.remove_suffix(1);
    std::string result(raw);
    for (char& c : result) c = c >= 0x20 && c < 0x7F ? c : '?';
    return result;
  }

 private:
  [[nodiscard]] bool is_inside(std::size_t offset, std::size_t size) const {
    return offset <= bytes_.size() && size <= bytes_.size() - offset;
  }

  std::string_view bytes_;
  bool is_little_endian_;
};

// The TIFF structure in the first Exif APP1 segment; empty where there is none.
std::string_view tiff_of_jpeg(std::string_view bytes) {
  const auto byte = [&](std::size_t offset) { return static_cast<unsigned char>(bytes[offset]); };
  if (bytes.size() < 4 || byte(0) != 0xFF || byte(1) != 0xD8) return {};
  std::size_t offset = 2;
  while (offset + 4 <= bytes.size() && byte(offset) == 0xFF) {
    const unsigned marker = byte(offset + 1);
    if (marker == 0xFF) {  // fill bytes before a marker
      ++offset;
      continue;
    }
    if (marker == 0xDA || marker == 0xD9) break;  // image data, or the end
    if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD7)) {
      offset += 2;
      continue;
    }
    const std::size_t length = 256U * byte(offset + 2) + byte(offset + 3);
    if (length < 2) break;
    // substr() ends where the bytes end: of a truncated file the rest is read.
    const std::string_view segment = bytes.substr(offset + 4, length - 2);
    if (marker == 0xE1 && segment.starts_with(kExifStart)) return segment.substr(kExifStart.size());
    offset += 2 + length;
  }
  return {};
}

// Degrees, minutes, seconds and hemisphere as degrees, within the limit.
std::optional<double> angle_of(const Tiff& tiff, std::size_t directory, int tag, int ref_tag,
                               std::string_view positive, std::string_view negative, double limit) {
  const std::optional<Entry> entry = tiff.find(directory, tag);
  const std::optional<double> degrees = tiff.number(entry, 0);
  const std::string ref = tiff.text(directory, ref_tag);
  if (!degrees || (ref != positive && ref != negative)) return std::nullopt;
  // Some cameras write decimal degrees and 0/0 for the rest.
  const double minutes = tiff.number(entry, 1).value_or(0);
  const double seconds = tiff.number(entry, 2).value_or(0);
  if (*degrees < 0 || minutes < 0 || minutes > 60 || seconds < 0 || seconds > 60)
    return std::nullopt;
  const double angle = *degrees + minutes / 60 + seconds / 3600;
  if (angle > limit) return std::nullopt;
  return ref == negative ? -angle : angle;
}

std::optional<Eigen::Vector3d> gps_of(const Tiff& tiff, std::size_t directory) {
  if (tiff.text(directory, kGpsStatus) == "V") return std::nullopt;
  const auto latitude = angle_of(tiff, directory, kLatitude, kLatitudeRef, "N", "S", 90);
  const auto longitude = angle_of(tiff, directory, kLongitude, kLongitudeRef, "E", "W", 180);
  if (!latitude || !longitude || (*latitude == 0 && *longitude == 0)) return std::nullopt;
  const double height = tiff.number_in(directory, kAltitude, -1e5, 1e5, 0);
  const bool is_below = tiff.number_in(directory, kAltitudeRef, 0, 1, 0) == 1;
  return Eigen::Vector3d(*latitude, *longitude, is_below ? -height : height);
}

constexpr double kEarthRadius = 6'378'137;                          // m, WGS84's semi-major axis
constexpr double kFlattening = 1 / 298.257223563;                   // WGS84
constexpr double kEccentricity2 = kFlattening * (2 - kFlattening);  // first eccentricity, squared

Eigen::Vector3d earth_centred(const Eigen::Vector3d& gps) {
  const double sine = std::sin(gps[0] * kDeg);
  const double cosine = std::cos(gps[0] * kDeg);
  const double normal = kEarthRadius / std::sqrt(1 - kEccentricity2 * sine * sine);
  return {(normal + gps[2]) * cosine * std::cos(gps[1] * kDeg),
          (normal + gps[2]) * cosine * std::sin(gps[1] * kDeg),
          (normal * (1 - kEccentricity2) + gps[2]) * sine};
}

// Geodetic latitude, rad, by Bowring's formula (Survey Review 1976); its error near the ground is
// 1e-9 degrees.
double latitude_of(const Eigen::Vector3d& x) {
  constexpr double kMinor = kEarthRadius * (1 - kFlattening);
  constexpr double kSecondEccentricity2 = kEccentricity2 / (1 - kEccentricity2);
  const double axis = std::hypot(x[0], x[1]);
  const double reduced = std::atan2(x[2] * kEarthRadius, axis * kMinor);
  const double sine = std::sin(reduced);
  const double cosine = std::cos(reduced);
  return std::atan2(x[2] + kSecondEccentricity2 * kMinor * sine * sine * sine,
                    axis - kEccentricity2 * kEarthRadius * cosine * cosine * cosine);
}

}  // namespace

Exif parse_exif(std::string_view jpeg_bytes) {
  Exif exif;
  const std::string_view bytes = tiff_of_jpeg(jpeg_bytes);
  const bool is_little_endian = bytes.starts_with("II");
  if (!is_little_endian && !bytes.starts_with("MM")) return exif;
  const Tiff tiff(bytes, is_little_endian);
  if (tiff.integer(2, 2) != 42) return exif;
  const std::size_t main = tiff.integer(4, 4);
  exif.orientation = static_cast<int>(tiff.number_in(main, kOrientation, 1, 8, 1));
  const std::string make = tiff.text(main, kMake);
  const std::string model = tiff.text(main, kModel);
  // Some model names begin with the maker.
  const bool model_has_make = make.empty() || model.starts_with(make);
  exif.camera = model_has_make ? model : model.empty() ? make : make + " " + model;

  const auto directory = [&](int tag) {
    return static_cast<std::size_t>(
        tiff.number_in(main, tag, 0, std::numeric_limits<std::uint32_t>::max(), 0));
  };
  const std::size_t details = directory(kExifDirectory);
  exif.focal_mm = tiff.number_in(details, kFocalLength, 0, 1e5, 0);
  exif.focal_35mm = tiff.number_in(details, kFocalLength35, 0, 1e5, 0);
  exif.original_px.width =
      static_cast<int>(tiff.number_in(details, kPixelXDimension, 1, kMaxSide, 0));
  exif.original_px.height =
      static_cast<int>(tiff.number_in(details, kPixelYDimension, 1, kMaxSide, 0));
  if (exif.original_px.width == 0 || exif.original_px.height == 0) exif.original_px = {};
  const double resolution = tiff.number_in(details, kFocalPlaneXResolution, 0, 1e9, 0);
  const int unit = static_cast<int>(tiff.number_in(details, kFocalPlaneResolutionUnit, 1, 5, 2));
  constexpr std::array<double, 6> kMmOfUnit{0, 0, 25.4, 10, 1, 1e-3};  // inch, cm, mm, um; 1: none
  const double mm = kMmOfUnit[static_cast<std::size_t>(unit)];
  if (mm > 0) exif.focal_plane_px_per_mm = resolution / mm;
  exif.gps = gps_of(tiff, directory(kGpsDirectory));
  return exif;
}

double focal_px_of(const Exif& exif, cv::Size size) {
  TARSIER_REQUIRE(size.width > 0 && size.height > 0, "an image of {}x{} px", size.width,
                  size.height);
  const double side = std::max(size.width, size.height);
  const double original = std::max(exif.original_px.width, exif.original_px.height);
  double focal = exif.focal_35mm / 36 * side;
  if (!(focal > 0)) {
    focal = exif.focal_mm * exif.focal_plane_px_per_mm * (original > 0 ? side / original : 1);
  }
  return focal >= 0.1 * side && focal <= 20 * side ? focal : 0;
}

std::vector<Eigen::Vector3d> local_metres(const std::vector<Eigen::Vector3d>& gps) {
  std::vector<Eigen::Vector3d> result;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& place : gps) {
    TARSIER_REQUIRE(
        std::abs(place[0]) <= 90 && std::abs(place[1]) <= 360 && std::isfinite(place[2]),
        "{}, {} deg, {} m is not a place", place[0], place[1], place[2]);
    result.push_back(earth_centred(place));
    mean += result.back();
  }
  if (gps.empty()) return result;
  mean /= static_cast<double>(gps.size());
  const double latitude = latitude_of(mean);
  const double longitude = std::atan2(mean[1], mean[0]);
  const double sp = std::sin(latitude);
  const double cp = std::cos(latitude);
  const double sl = std::sin(longitude);
  const double cl = std::cos(longitude);
  const Eigen::Matrix3d east_north_up{
      {-sl, cl, 0}, {-sp * cl, -sp * sl, cp}, {cp * cl, cp * sl, sp}};
  for (Eigen::Vector3d& x : result) x = east_north_up * (x - mean);
  return result;
}

}  // namespace tarsier::sfm
