// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/landmarks/packing.h"
#include "tarsier/face/landmarks/trees.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::face::landmarks {
namespace {

using nlohmann::json;

// Numbers of 16 bits as pairs of bytes, the low one first; the last size of the shape is 2.
template <typename T>
json pack_pairs(const std::vector<T>& values, std::vector<std::int64_t> shape) {
  PackedArray<std::uint8_t> bytes;
  bytes.shape = std::move(shape);
  bytes.shape.push_back(2);
  bytes.values.reserve(2 * values.size());
  for (const T value : values) {
    const auto bits = static_cast<std::uint16_t>(value);
    bytes.values.push_back(static_cast<std::uint8_t>(bits & 0xFF));
    bytes.values.push_back(static_cast<std::uint8_t>(bits >> 8));
  }
  return pack(bytes);
}

template <typename T>
std::vector<T> unpack_pairs(const json& value, const std::string& path, std::string_view what,
                            std::initializer_list<std::int64_t> shape) {
  const PackedArray<std::uint8_t> bytes = unpack<std::uint8_t>(value, path, what, shape);
  std::vector<T> values(bytes.values.size() / 2);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const unsigned bits = bytes.values[2 * i] | (unsigned{bytes.values[2 * i + 1]} << 8);
    values[i] = static_cast<std::int16_t>(static_cast<std::uint16_t>(bits));
  }
  return values;
}

template <typename Matrix, typename T>
Matrix two_rows(const PackedArray<T>& array) {
  return Eigen::Map<const Matrix>(array.values.data(), 2, array.shape[0]);
}

template <typename T, typename Matrix>
json pack_points(const Matrix& points) {
  return pack(PackedArray<T>{{points.cols(), 2}, {points.data(), points.data() + points.size()}});
}

}  // namespace

json to_json(const Trees& model) {
  model.check();
  const std::int64_t nodes = (std::int64_t{1} << model.depth) - 1;
  json levels = json::array();
  for (const Trees::Level& level : model.levels) {
    const std::int64_t trees = static_cast<std::int64_t>(level.first.size()) / nodes;
    const auto pixels = static_cast<std::int64_t>(level.anchor.size());
    PackedArray<std::uint8_t> leaves;
    leaves.shape = {trees, nodes + 1, level.basis.cols()};
    for (const std::int8_t number : level.leaves)
      leaves.values.push_back(static_cast<std::uint8_t>(number));
    levels.push_back({{"anchor", pack(PackedArray<std::int32_t>{{pixels}, level.anchor})},
                      {"offset", pack_points<float>(level.offset)},
                      {"first", pack_pairs(level.first, {trees, nodes})},
                      {"second", pack_pairs(level.second, {trees, nodes})},
                      {"threshold", pack_pairs(level.threshold, {trees, nodes})},
                      {"basis", packed(level.basis)},
                      {"leaves", pack(leaves)}});
  }
  return {{"mean", pack_points<double>(model.mean)},
          {"depth", model.depth},
          {"smoothing", model.smoothing},
          {"levels", std::move(levels)}};
}

Trees trees_from_json(const json& value, const std::string& path) {
  Trees model;
  const auto mean = unpack<double>(member(value, "mean", path), path, "mean", {-1, 2});
  if (mean.shape[0] < 2 || mean.shape[0] > 1000)
    throw ModelError(path, fmt::format("mean: {} points, 2..1000 are possible", mean.shape[0]));
  model.mean = two_rows<Eigen::Matrix2Xd>(mean);
  model.depth = static_cast<int>(integer_member(value, "depth", path, 1, 8));
  model.smoothing = static_cast<float>(number_member(value, "smoothing", path, 0, 1));
  const std::int64_t nodes = (std::int64_t{1} << model.depth) - 1;
  const json& levels = member(value, "levels", path);
  if (!levels.is_array() || levels.empty() || levels.size() > 30)
    throw ModelError(path, "levels: a list of 1 to 30 is expected");
  for (const json& item : levels) {
    Trees::Level level;
    level.anchor = unpack<std::int32_t>(member(item, "anchor", path), path, "anchor", {-1}).values;
    const auto pixels = static_cast<std::int64_t>(level.anchor.size());
    level.offset = two_rows<Eigen::Matrix2Xf>(
        unpack<float>(member(item, "offset", path), path, "offset", {pixels, 2}));
    level.first =
        unpack_pairs<std::int32_t>(member(item, "first", path), path, "first", {-1, nodes, 2});
    const std::int64_t trees = static_cast<std::int64_t>(level.first.size()) / nodes;
    level.second =
        unpack_pairs<std::int32_t>(member(item, "second", path), path, "second", {trees, nodes, 2});
    level.threshold = unpack_pairs<std::int16_t>(member(item, "threshold", path), path, "threshold",
                                                 {trees, nodes, 2});
    level.basis = unpacked(member(item, "basis", path), path, "basis", 2 * model.mean.cols(), -1);
    for (const std::uint8_t number :
         unpack<std::uint8_t>(member(item, "leaves", path), path, "leaves",
                              {trees, nodes + 1, level.basis.cols()})
             .values)
      level.leaves.push_back(static_cast<std::int8_t>(number));
    model.levels.push_back(std::move(level));
  }
  return checked(std::move(model), path);
}

}  // namespace tarsier::face::landmarks
