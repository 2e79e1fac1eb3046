// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>

// Faces that a model makes.
namespace tarsier::face::appearance {

// Draws textures of one model; holds the modes as they are used. Refers to the model, which must
// live on. Immutable.
class Synthesis {
 public:
  // Of the colour texture; throws std::invalid_argument where the model has none, unless the finest
  // level is of brightness: then grey.
  explicit Synthesis(const AppearanceModel& model);

  [[nodiscard]] const Texture& texture() const { return *texture_; }
  [[nodiscard]] const Eigen::MatrixXf& modes() const { return modes_; }

  // The texture offset + gain (mean + modes c) in its frame, CV_8UC3, 0 outside the mesh. c may be
  // shorter than there are modes.
  [[nodiscard]] cv::Mat frame(const Eigen::VectorXd& c, double offset, double gain) const;
  [[nodiscard]] cv::Mat frame(const Eigen::VectorXd& c = {}) const;  // usual offset and gain

  // Draws it over `image` (CV_8UC3) where the points (2 x n, px) lie.
  void draw(const Eigen::VectorXd& c, double offset, double gain, const Eigen::Matrix2Xd& points,
            cv::Mat& image) const;

  // What the model sees in an image under the points: the appearance of its colour texture.
  [[nodiscard]] Explained explain(const cv::Mat& image, const Eigen::Matrix2Xd& points) const;

  // A face of shape b and texture c, upright, on a plain ground, as large as fits into `size`.
  [[nodiscard]] cv::Mat portrait(const Eigen::VectorXd& b, const Eigen::VectorXd& c, cv::Size size,
                                 Eigen::Matrix2Xd* points = nullptr) const;

 private:
  const AppearanceModel* model_;
  const Texture* texture_;
  Eigen::MatrixXf modes_;
};

// Random parameters: normal with the model's deviations, times `spread`, each within 2.5 of them.
struct RandomFace {
  Eigen::VectorXd b;
  Eigen::VectorXd c;
};
[[nodiscard]] RandomFace random_face(const AppearanceModel& model, const Texture& texture,
                                     std::uint64_t seed, double spread = 1);

// Modes as a grid with labels: rows are the first modes of the shape and of the texture (at most
// `modes` of each), columns -3, -1.5, 0, 1.5, 3 deviations. Also a row of random faces.
[[nodiscard]] cv::Mat draw_mode_grid(const AppearanceModel& model, int modes, int cell_px,
                                     std::uint64_t seed = 1);

// The mesh and points over an image (CV_8UC3).
void draw_mesh(const AppearanceModel& model, const Eigen::Matrix2Xd& points, cv::Mat& image,
               bool with_outer = false);

// What the model sees and does not explain at the points: the texture of the finest level, its
// reconstruction and the difference (grey 128: none), side by side, CV_8UC3; of feature channels
// the mean of the squares over channels.
[[nodiscard]] cv::Mat draw_error(const AppearanceModel& model, const cv::Mat& image,
                                 const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::appearance
