// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/target_io.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

namespace tarsier::planar::image_targets {
namespace {

using nlohmann::json;

constexpr const char* kType = "image-target";
constexpr int kVersion = 1;
constexpr std::int64_t kMaxFeatures = 20'000;
constexpr std::int64_t kMaxSide = 2000;  // px
constexpr std::int64_t kSketchBytes = 8 * kSketchWords;

json quality_json(const Quality& q) {
  return {{"rating", q.rating},     {"features", q.features},        {"spread", q.spread},
          {"distinct", q.distinct}, {"repeatable", q.repeatability}, {"reasons", q.reasons}};
}

Quality read_quality(const json& value, const std::string& path) {
  Quality q;
  q.rating = number_member(value, "rating", path, 0, 1);
  q.features = number_member(value, "features", path, 0, 1);
  q.spread = number_member(value, "spread", path, 0, 1);
  q.distinct = number_member(value, "distinct", path, 0, 1);
  q.repeatability = number_member(value, "repeatable", path, 0, 1);
  const json& reasons = member(value, "reasons", path);
  if (!reasons.is_array() || reasons.size() > 20)
    throw ModelError(path, "'reasons': expected a list of up to 20 lines");
  for (const json& reason : reasons) {
    if (!reason.is_string() || reason.get_ref<const std::string&>().size() > 500)
      throw ModelError(path, "'reasons': expected only lines of text");
    q.reasons.push_back(reason.get<std::string>());
  }
  return q;
}

// Little-endian on all machines.
void put_word(std::uint64_t word, std::vector<std::uint8_t>& out) {
  for (int b = 0; b < 8; ++b) out.push_back(static_cast<std::uint8_t>(word >> (8 * b)));
}

std::uint64_t take_word(const std::uint8_t* bytes) {
  std::uint64_t word = 0;
  for (int b = 7; b >= 0; --b) word = word << 8 | bytes[b];
  return word;
}

void read_features(const json& value, const std::string& path, Target& target) {
  const auto points = unpack<float>(member(value, "points", path), path, "points", {-1, 2});
  const std::int64_t n = points.shape[0];
  if (n > kMaxFeatures)
    throw ModelError(path, fmt::format("has {} features, {} are the most", n, kMaxFeatures));
  const auto frames = unpack<float>(member(value, "frames", path), path, "frames", {n, 4});
  const auto right = unpack<std::int32_t>(member(value, "right", path), path, "right", {n});
  const auto values = unpack<std::uint8_t>(member(value, "descriptions", path), path,
                                           "descriptions", {n, kDescriptorSize});
  const auto bits =
      unpack<std::uint8_t>(member(value, "sketches", path), path, "sketches", {n, kSketchBytes});
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
    TrainedFeature f;
    f.at = {points.values[2 * i], points.values[2 * i + 1]};
    if (!(f.at.x >= -1 && f.at.y >= -1 && f.at.x <= static_cast<float>(target.gray.cols) &&
          f.at.y <= static_cast<float>(target.gray.rows))) {
      throw ModelError(path, fmt::format("feature {} lies outside the image", i));
    }
    for (std::size_t k = 0; k < 4; ++k) f.frame.val[k] = frames.values[4 * i + k];
    const float area = std::fabs(f.frame(0, 0) * f.frame(1, 1) - f.frame(0, 1) * f.frame(1, 0));
    if (!(area > 1e-2F && area < 1e6F) || !(cv::norm(f.frame) < 1e4))
      throw ModelError(path, fmt::format("feature {} has no size", i));
    f.correct_matches = right.values[i];
    if (f.correct_matches < 0 || f.correct_matches > 1'000'000)
      throw ModelError(path, fmt::format("feature {} was right {} times", i, f.correct_matches));
    target.features.push_back(f);
    Descriptor d;
    std::copy_n(values.values.begin() + static_cast<std::ptrdiff_t>(i * kDescriptorSize),
                kDescriptorSize, d.values.begin());
    for (std::size_t w = 0; w < kSketchWords; ++w)
      d.sketch[w] = take_word(bits.values.data() + i * kSketchBytes + 8 * w);
    target.descriptors.push_back(d);
  }
}

}  // namespace

void write_target(const std::string& path, const Target& target, const json& provenance) {
  require_gray(target.gray);
  TARSIER_REQUIRE(target.features.size() == target.descriptors.size(), "{} features, {} described",
                  target.features.size(), target.descriptors.size());
  const auto n = static_cast<std::int64_t>(target.features.size());
  PackedArray<std::uint8_t> image{{target.gray.rows, target.gray.cols}, {}};
  for (int r = 0; r < target.gray.rows; ++r)
    image.values.insert(image.values.end(), target.gray.ptr(r),
                        target.gray.ptr(r) + target.gray.cols);
  PackedArray<float> points{{n, 2}, {}};
  PackedArray<float> frames{{n, 4}, {}};
  PackedArray<std::int32_t> right{{n}, {}};
  PackedArray<std::uint8_t> values{{n, kDescriptorSize}, {}};
  PackedArray<std::uint8_t> bits{{n, kSketchBytes}, {}};
  for (std::size_t i = 0; i < target.features.size(); ++i) {
    const TrainedFeature& f = target.features[i];
    points.values.insert(points.values.end(), {f.at.x, f.at.y});
    frames.values.insert(frames.values.end(), f.frame.val, f.frame.val + 4);
    right.values.push_back(f.correct_matches);
    const Descriptor& d = target.descriptors[i];
    values.values.insert(values.values.end(), d.values.begin(), d.values.end());
    for (const std::uint64_t word : d.sketch) put_word(word, bits.values);
  }
  Archive archive;
  archive.type = kType;
  archive.version = kVersion;
  archive.provenance = provenance;
  archive.payload = {{"name", target.name},
                     {"width", target.width},
                     {"height", target.height},
                     {"given", {target.original_size.width, target.original_size.height}},
                     {"image", pack(image)},
                     {"points", pack(points)},
                     {"frames", pack(frames)},
                     {"right", pack(right)},
                     {"descriptions", pack(values)},
                     {"sketches", pack(bits)},
                     {"quality", quality_json(target.quality)}};
  write_archive(path, archive);
}

Target read_target(const std::string& path) {
  ArchiveLimits limits;
  limits.max_bytes = 32'000'000;
  limits.max_values = 10'000;
  const Archive archive = read_archive(path, kType, kVersion, limits);
  const json& value = archive.payload;
  Target target;
  target.name = text_member(value, "name", path, 400);
  target.width = number_member(value, "width", path, 1e-4, 1e3);
  target.height = number_member(value, "height", path, 1e-4, 1e3);
  const json& given = member(value, "given", path);
  for (std::size_t k = 0; k < 2; ++k) {
    if (!given.is_array() || given.size() != 2 || !given[k].is_number_integer() || given[k] < 8 ||
        given[k] > 200'000) {
      throw ModelError(path, "'given': expected the width and height of an image");
    }
  }
  target.original_size = {given[0].get<int>(), given[1].get<int>()};
  const auto image = unpack<std::uint8_t>(member(value, "image", path), path, "image", {-1, -1});
  if (image.shape[0] < 8 || image.shape[1] < 8 || image.shape[0] > kMaxSide ||
      image.shape[1] > kMaxSide) {
    throw ModelError(path, fmt::format("'image' is {}x{}: sides of 8..{} px", image.shape[1],
                                       image.shape[0], kMaxSide));
  }
  const auto rows = static_cast<int>(image.shape[0]);
  const auto cols = static_cast<int>(image.shape[1]);
  target.gray.create(rows, cols, CV_8UC1);
  std::memcpy(target.gray.data, image.values.data(), image.values.size());
  const double aspect = target.height * cols / (target.width * rows);
  if (!(aspect > 0.5 && aspect < 2))
    throw ModelError(path, "'width' and 'height' do not fit the image's shape");
  read_features(value, path, target);
  target.quality = read_quality(member(value, "quality", path), path);
  compute_derived_members(target);
  return target;
}

}  // namespace tarsier::planar::image_targets
