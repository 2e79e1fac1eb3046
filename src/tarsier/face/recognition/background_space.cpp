// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/background_space.h"

#include "tarsier/core/require.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/features.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace tarsier::face::recognition {
namespace {

// FNV-1a of 32-bit words.
class Fingerprint {
 public:
  void add(std::uint32_t word) {
    for (int byte = 0; byte < 4; ++byte) {
      hash_ ^= (word >> (8 * byte)) & 0xFFU;
      hash_ *= 0x100000001B3ULL;
    }
  }
  void add(double value) { add(std::bit_cast<std::uint32_t>(static_cast<float>(value))); }
  void add(int value) { add(static_cast<std::uint32_t>(value)); }
  [[nodiscard]] std::int64_t value() const {
    return static_cast<std::int64_t>(std::max<std::uint64_t>(1, hash_ >> 1));
  }

 private:
  std::uint64_t hash_ = 0xCBF29CE484222325ULL;
};

void require_directions(const Background& background) {
  TARSIER_REQUIRE(background.basis.rows() > 0, "a background of a mean alone");
}

}  // namespace

std::vector<float> coordinates_of(const Background& background, const cv::Mat& face,
                                  const DescriptorOptions& descriptor) {
  require_directions(background);
  const std::vector<float> values =
      background.network ? embed_crop(*background.network, face) : describe(face, descriptor);
  const Rows out = coordinates_of_rows(
      background,
      Eigen::Map<const Rows>(values.data(), 1, static_cast<Eigen::Index>(values.size())));
  return {out.data(), out.data() + out.size()};
}

Rows coordinates_of_rows(const Background& background, const Rows& described) {
  require_directions(background);
  TARSIER_REQUIRE(described.cols() == background.mean.size(),
                  "a background of {} numbers for descriptors of {}", background.mean.size(),
                  described.cols());
  const Rows off = described.rowwise() - background.mean;
  const Eigen::Index m = background.basis.rows();
  Rows out(off.rows(), m + 1);
  out.leftCols(m) = products(off, background.basis);
  for (Eigen::Index i = 0; i < off.rows(); ++i)
    out(i, m) =
        static_cast<float>(std::max(0.0, off.row(i).cast<double>().squaredNorm() -
                                             out.row(i).head(m).cast<double>().squaredNorm()));
  return out;
}

int coordinate_count(const Background& background) {
  return static_cast<int>(background.basis.rows()) + 1;
}

std::int64_t fingerprint(const Background& background, const DescriptorOptions& descriptor) {
  Fingerprint print;
  print.add(descriptor.size.width);
  print.add(descriptor.size.height);
  print.add(descriptor.symmetric ? 1 : 0);
  for (const HogChannel& channel : descriptor.channels) {
    print.add(static_cast<int>(channel.light));
    print.add(channel.cell);
    print.add(channel.directions);
    print.add(channel.full_circle ? 1 : 0);
  }
  if (background.network) {
    const auto network = static_cast<std::uint64_t>(background.network->fingerprint);
    print.add(static_cast<std::uint32_t>(network));
    print.add(static_cast<std::uint32_t>(network >> 32));
  }
  print.add(static_cast<int>(background.basis.rows()));
  for (Eigen::Index i = 0; i < background.mean.size(); ++i)
    print.add(static_cast<double>(background.mean(i)));
  for (Eigen::Index i = 0; i < background.basis.size(); ++i)
    print.add(static_cast<double>(background.basis.data()[i]));
  return print.value();
}

Rows templates_of_coordinates(const Recognizer& model, const Background& background,
                              const Rows& coordinates) {
  return CoordinateProjection(model, background)(coordinates);
}

CoordinateProjection::CoordinateProjection(const Recognizer& model, const Background& background)
    : eigenvalues_(model.eigenvalues), residual_variance_(model.residual_variance) {
  require_directions(background);
  TARSIER_REQUIRE(model.mean.size() == background.mean.size(), "a model of {} inputs, {} wanted",
                  model.mean.size(), background.mean.size());
  // The directions are orthonormal, and the model's directions lie in their span.
  shift_ = products(Rows(model.mean - background.mean), background.basis);
  inner_ = products(model.components, background.basis);
}

Rows CoordinateProjection::operator()(const Rows& coordinates) const {
  const Eigen::Index m = inner_.cols();
  TARSIER_REQUIRE(coordinates.rows() == 0 || coordinates.cols() == m + 1,
                  "coordinates of {} numbers, the background has {} directions", coordinates.cols(),
                  m);
  Rows out(coordinates.rows(), inner_.rows());
  constexpr Eigen::Index kBlock = 1024;
  for (Eigen::Index first = 0; first < coordinates.rows(); first += kBlock) {
    const Eigen::Index count = std::min(kBlock, coordinates.rows() - first);
    const Rows centred =
        coordinates.block(first, 0, count, m).rowwise() - Eigen::RowVectorXf(shift_.row(0));
    const Eigen::VectorXd square = centred.cast<double>().rowwise().squaredNorm() +
                                   coordinates.block(first, m, count, 1).cast<double>();
    Rows block = products(centred, inner_);
    scale_rows(block, square, eigenvalues_, residual_variance_);
    out.middleRows(first, count) = block;
  }
  return out;
}

}  // namespace tarsier::face::recognition
