// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/channels.h"
#include "tarsier/face/appearance/training_image.h"
#include "tarsier/face/shape/piecewise_warp.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Active appearance models (Cootes, Edwards and Taylor, ECCV 1998; here with independent shape and
// appearance: Matthews and Baker, "Active appearance models revisited", IJCV 2004).
namespace tarsier::face::appearance {

struct AppearanceOptions {
  shape::ShapeModelOptions shape{.variance = 0.97, .max_modes = 30};
  Channels channels = Channels::kGrey;  // for the fit
  int frame_width = 100;                // px of the finest mean frame
  int levels = 2;                       // resolution levels, each half of the one before
  // Extension of the frame beyond the points' hull, share of their distance from the centre, so
  // that the fit sees both sides of the outline.
  double margin = 0;
  double texture_variance = 0.95;  // share of the variance that the modes keep
  int texture_modes = 100;         // max number
  bool mirror = false;             // also train on mirrored images; needs the symmetry
  double to_the_right = 0;         // see mirrored(), px
  bool colour = true;              // also train a colour texture, for synthesis
  int colour_width = 100;          // px
  double colour_variance = 0.97;
  int colour_modes = 60;
  // Of the points; empty: Delaunay. Must be empty with a margin.
  std::vector<shape::Triangle> mesh{};

  [[nodiscard]] OptionFields fields() {
    return {{"frame_width", frame_width, range(16, 1000), "--width",
             "px, width of the mean frame of the fit"},
            {"levels", levels, range(1, 5), "--levels",
             "number of pyramid levels, each half the size of the one before"},
            {"margin", margin, range(0, 1)},
            {"texture_variance", texture_variance, above(0, 1), "--texture-variance",
             "share of the variance kept by the texture modes"},
            {"texture_modes", texture_modes, range(0, 1000), "--texture-modes",
             "maximum number of texture modes"},
            {"mirror", mirror, "--mirror", "add mirrored images to the training set"},
            {"to_the_right", to_the_right, range(-100, 100), "--to-the-right",
             "horizontal offset of the annotations to the right, px (1 for pixels counted from 1, "
             "as in faces68)"},
            {"colour_width", colour_width, range(16, 1000), "--colour-width",
             "px, width of the frame in which faces are drawn"},
            {"colour_variance", colour_variance, above(0, 1)},
            {"colour_modes", colour_modes, range(0, 1000), "--colour-modes",
             "maximum number of colour modes"}};
  }
  void check() const;
};

// Textures in the frame of one resolution: vectors g with `channels` numbers per pixel of the warp,
// pixel by pixel. A texture is normalised by its offset o (mean of all numbers, if has_offset) and
// gain a (so that its projection on the mean is the mean):
//   g = o + a (mean + modes c).
// The mean has RMS 1. Modes are orthonormal, and orthogonal to the mean and (if has_offset) to
// constants.
struct Texture {
  Texture(shape::PiecewiseWarp frame_warp, Channels texture_channels)
      : warp(std::move(frame_warp)), channels(texture_channels) {}

  shape::PiecewiseWarp warp;
  Channels channels;
  double px_per_unit = 1;        // px of the frame per unit of the shape model
  Eigen::Vector2d origin{0, 0};  // px of the frame, origin of the shape model
  Eigen::VectorXf mean;          // N = pixels x channels
  // Modes in storage format: 8-bit numbers, each column with its own step. modes() makes them
  // orthonormal.
  Eigen::Matrix<std::int8_t, Eigen::Dynamic, Eigen::Dynamic> packed_modes;  // N x m
  Eigen::VectorXf steps;                                                    // m
  Eigen::VectorXd deviation;                                                // m, of c, falling
  double variance_kept = 1;
  double noise = 0;        // RMS of the part of a number that the modes do not explain, in training
  double mean_offset = 0;  // means over the training textures, for synthesis
  double mean_gain = 1;

  [[nodiscard]] int size() const { return static_cast<int>(mean.size()); }
  [[nodiscard]] int mode_count() const { return static_cast<int>(deviation.size()); }
  [[nodiscard]] Eigen::MatrixXf modes() const;  // N x m
};

// The position of a shape in a detector's box, medians over training. Shapes are upright, with
// their centre (mean of the points) at the box centre + (dx, dy) * width and RMS radius size *
// width.
struct ShapeInBox {
  double dx = 0;
  double dy = 0;
  double size = 0.4;
  int boxes = 0;  // that it was learned from; 0: unknown
};

struct AppearanceModel {
  shape::ShapeModel shape;
  // Points of the frame: the shape's, and for each of `outer` an additional point outside, at p +
  // margin (p - centre of all points).
  double margin = 0;
  std::vector<int> outer;
  std::vector<shape::Triangle> mesh;
  std::vector<Texture> levels;    // for the fit, finest first
  std::optional<Texture> colour;  // for synthesis
  // Fit errors (FitResult::error) above this mean that the object is not there; 0: unknown.
  double lost_error = 0;
  ShapeInBox shape_in_box;

  [[nodiscard]] int points() const { return shape.points(); }
  // The points of the frame for a shape (2 x points() to 2 x (points() + outer.size())).
  [[nodiscard]] Eigen::Matrix2Xd extended(const Eigen::Matrix2Xd& points) const;
  void check() const;  // throws std::invalid_argument
};

// Throws std::invalid_argument for fewer than 2 images, or a mesh that folds in the mean shape;
// Interrupted. The result does not depend on the number of threads.
[[nodiscard]] AppearanceModel train_appearance_model(const std::vector<TrainingImage>& images,
                                                     const std::vector<int>& mirror,
                                                     const AppearanceOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop);

// A texture sampled from an image, and its reconstruction by the model.
struct TextureFit {
  Eigen::VectorXf sampled;  // N
  double offset = 0;
  double gain = 0;
  Eigen::VectorXd c;  // m
  // RMS of the part of (sampled - offset) that the model does not explain / RMS of (sampled -
  // offset): 0 everything is explained, 1 nothing.
  double error = 0;
  double inside = 1;  // share of the frame's pixels in the image
};
// `points`: 2 x points(), px of `image` (CV_8UC1, CV_8UC3). `modes` = texture.modes().
[[nodiscard]] TextureFit fit_texture(const AppearanceModel& model, const Texture& texture,
                                     const Eigen::MatrixXf& modes, const cv::Mat& image,
                                     const Eigen::Matrix2Xd& points);

// The crop in which a texture is sampled: the frame with a margin.
struct CropFrame {
  shape::Similarity2d crop_from_model;
  cv::Size size;
};
[[nodiscard]] CropFrame crop_frame(const Texture& texture);

// The frame of a model at a given resolution, with an empty texture.
[[nodiscard]] Texture empty_texture(const AppearanceModel& model, Channels channels,
                                    double px_per_unit);

// Model files of type "appearance-model". from_json throws ModelError(path).
[[nodiscard]] nlohmann::json to_json(const AppearanceModel& model);
[[nodiscard]] AppearanceModel appearance_model_from_json(const nlohmann::json& value,
                                                         const std::string& path);
void write_appearance_model(const std::string& path, const AppearanceModel& model,
                            const nlohmann::json& provenance);
[[nodiscard]] AppearanceModel read_appearance_model(const std::string& path);

}  // namespace tarsier::face::appearance
