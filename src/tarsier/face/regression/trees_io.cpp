// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/trees.h"
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::regression {
namespace {

// 16-bit numbers as pairs of bytes, low byte first.
template <typename T>
void list_pairs(linalg::ModelFields& file, const char* name, std::vector<T>& values,
                std::int64_t trees, std::int64_t nodes) {
  PackedArray<std::uint8_t> bytes{{static_cast<std::int64_t>(values.size()) / nodes, nodes, 2}, {}};
  bytes.values.reserve(2 * values.size());
  for (const T value : values) {
    const auto bits = static_cast<std::uint16_t>(value);
    bytes.values.push_back(static_cast<std::uint8_t>(bits & 0xFF));
    bytes.values.push_back(static_cast<std::uint8_t>(bits >> 8));
  }
  file.array(name, bytes, {trees, nodes, 2});
  if (!file.reads()) return;
  values.resize(bytes.values.size() / 2);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const unsigned bits = bytes.values[2 * i] | (unsigned{bytes.values[2 * i + 1]} << 8);
    values[i] = static_cast<std::int16_t>(static_cast<std::uint16_t>(bits));
  }
}

void list_level(linalg::ModelFields& file, Trees::Level& level, std::int64_t nodes,
                std::int64_t points) {
  file.list<std::int32_t>("anchor", level.anchor, -1);
  file.points("offset", level.offset, static_cast<std::int64_t>(level.anchor.size()));
  list_pairs(file, "first", level.first, -1, nodes);
  const std::int64_t trees = static_cast<std::int64_t>(level.first.size()) / nodes;
  list_pairs(file, "second", level.second, trees, nodes);
  list_pairs(file, "threshold", level.threshold, trees, nodes);
  file.matrix("basis", level.basis, 2 * points, -1);
  PackedArray<std::uint8_t> leaves{{trees, nodes + 1, level.basis.cols()}, {}};
  for (const std::int8_t number : level.leaves)
    leaves.values.push_back(static_cast<std::uint8_t>(number));
  file.array("leaves", leaves, {trees, nodes + 1, level.basis.cols()});
  if (!file.reads()) return;
  for (const std::uint8_t number : leaves.values)
    level.leaves.push_back(static_cast<std::int8_t>(number));
}

void list_trees(linalg::ModelFields& file, Trees& model) {
  file.points("mean", model.mean, -1);
  const Eigen::Index points = model.mean.cols();
  file.require(points >= 2 && points <= 1000, "mean: {} points, 2..1000 are possible", points);
  file.whole("depth", model.depth, 1, 8);
  file.number("smoothing", model.smoothing, 0, 1);
  const std::int64_t nodes = (std::int64_t{1} << model.depth) - 1;
  file.parts("levels", model.levels, 1, 30, [&](linalg::ModelFields& item, Trees::Level& level) {
    list_level(item, level, nodes, points);
  });
}

}  // namespace

nlohmann::json to_json(const Trees& model) {
  model.check();
  return linalg::written(model, list_trees);
}

Trees trees_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_checked<Trees>(value, path, list_trees);
}

}  // namespace tarsier::face::regression
