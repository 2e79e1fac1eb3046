// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/subspace.h"
#include "tarsier/media/archive.h"

#include <string>

// Rows of numbers in the files of this module.
namespace tarsier::face::recognition {

[[nodiscard]] inline nlohmann::json packed(const Rows& rows) {
  return pack(
      PackedArray<float>{{rows.rows(), rows.cols()}, {rows.data(), rows.data() + rows.size()}});
}

// `object[name]`, `rows` x `cols` (-1: any); else ModelError names `path`.
[[nodiscard]] inline Rows unpacked(const nlohmann::json& object, const std::string& name,
                                   const std::string& path, std::int64_t rows, std::int64_t cols) {
  const auto array = unpack<float>(member(object, name, path), path, name, {rows, cols});
  return Eigen::Map<const Rows>(array.values.data(), array.shape[0], array.shape[1]);
}

}  // namespace tarsier::face::recognition
