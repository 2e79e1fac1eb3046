// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>

// Synthesis of faces by a model.
namespace tarsier::face::appearance {

// Draws textures of one model; stores the unpacked modes. Refers to the model, which must outlive
// it. Immutable.
class Synthesis {
 public:
  // Uses the colour texture. Without one, uses the finest level if that is of brightness (grey
  // images); otherwise throws std::invalid_argument.
  explicit Synthesis(const AppearanceModel& model);

  [[nodiscard]] const Texture& texture() const { return *texture_; }
  [[nodiscard]] const Eigen::MatrixXf& modes() const { return modes_; }

  // The texture offset + gain (mean + modes c) in its frame, CV_8UC3, 0 outside the mesh. c may be
  // shorter than the number of modes.
  [[nodiscard]] cv::Mat frame(const Eigen::VectorXd& c, double offset, double gain) const;
  [[nodiscard]] cv::Mat frame(const Eigen::VectorXd& c = {}) const;  // usual offset and gain

  // Draws it over `image` (CV_8UC3) at the points (2 x n, px).
  void draw(const Eigen::VectorXd& c, double offset, double gain, const Eigen::Matrix2Xd& points,
            cv::Mat& image) const;

  // The texture of an image at the points, explained by the model's colour texture.
  [[nodiscard]] TextureFit fit_texture(const cv::Mat& image, const Eigen::Matrix2Xd& points) const;

  // A face of shape b and texture c, upright, on a plain background, as large as fits into `size`.
  [[nodiscard]] cv::Mat portrait(const Eigen::VectorXd& b, const Eigen::VectorXd& c, cv::Size size,
                                 Eigen::Matrix2Xd* points = nullptr) const;

 private:
  const AppearanceModel* model_;
  const Texture* texture_ = nullptr;
  Eigen::MatrixXf modes_;
};

// Random parameters: normal with the model's deviations times `spread`, each limited to 2.5 of
// these.
struct RandomFace {
  Eigen::VectorXd b;
  Eigen::VectorXd c;
};
[[nodiscard]] RandomFace random_face(const AppearanceModel& model, const Texture& texture,
                                     std::uint64_t seed, double spread = 1);

// The modes as a labelled grid. Rows: the first modes of the shape and of the texture (at most
// `modes` of each), and a row of random faces. Columns: -3, -1.5, 0, 1.5, 3 deviations.
[[nodiscard]] cv::Mat draw_mode_grid(const AppearanceModel& model, int modes, int cell_px,
                                     std::uint64_t seed = 1);

// Draws the mesh and points over an image (CV_8UC3).
void draw_mesh(const AppearanceModel& model, const Eigen::Matrix2Xd& points, cv::Mat& image,
               bool with_outer = false);

// The texture of the finest level at the points, its reconstruction and the difference (grey 128:
// none), side by side, CV_8UC3. For feature channels, the mean of the squares over the channels is
// shown.
[[nodiscard]] cv::Mat draw_error(const AppearanceModel& model, const cv::Mat& image,
                                 const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::appearance
