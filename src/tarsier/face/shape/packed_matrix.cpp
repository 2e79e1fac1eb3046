// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/packed_matrix.h"

#include "tarsier/media/archive.h"

namespace tarsier::face::shape {

nlohmann::json packed(const Eigen::MatrixXd& matrix) {
  PackedArray<double> array;
  array.shape = {matrix.rows(), matrix.cols()};
  array.values.reserve(static_cast<std::size_t>(matrix.size()));
  for (Eigen::Index r = 0; r < matrix.rows(); ++r)
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) array.values.push_back(matrix(r, c));
  return pack(array);
}

Eigen::MatrixXd unpacked(const nlohmann::json& object, const std::string& path,
                         const std::string& name, std::int64_t rows, std::int64_t cols) {
  const auto array = unpack<double>(member(object, name, path), path, name, {rows, cols});
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const RowMajor>(array.values.data(), array.shape[0], array.shape[1]);
}

}  // namespace tarsier::face::shape
