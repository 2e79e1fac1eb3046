// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/render/mesh.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>

// Synthetic heads with exact ground truth. A head is a sample of the 3D head model (positions of
// the points) and of an appearance model (texture), seen by a camera in a known pose. The mesh of
// the points ends at the brows. A plain skull, hair and neck are added around it, so that detectors
// find a head.
namespace tarsier::synth {

struct FacePerson {
  Eigen::VectorXd b;           // of the head model, mm; may be shorter than its number of modes
  Eigen::VectorXd c;           // of the appearance model's colour texture; may be shorter
  cv::Vec3b hair{40, 45, 55};  // BGR
};

struct FaceSceneOptions {
  double ambient = 0.75;   // ambient light
  double diffuse = 0.35;   // directional light
  double light_yaw = -30;  // degrees, direction of the light; + image right
  double noise = 2;        // standard deviation, grey levels
  double blur_px = 0.6;    // standard deviation
  bool with_background =
      true;  // a smooth random background; false: the background of the input image

  [[nodiscard]] OptionFields fields() {
    return {{"ambient", ambient, range(0, 2)},
            {"diffuse", diffuse, range(0, 2)},
            {"light_yaw", light_yaw, range(-90, 90)},
            {"noise", noise, range(0, 50), "--noise",
             "grey levels, standard deviation of the image noise"},
            {"blur_px", blur_px, range(0, 20), "--blur", "px, standard deviation of the blur"}};
  }
  void check() const { check_fields(*this); }
};

struct FaceTruth {
  Eigen::Matrix2Xd points;            // 2 x n, px
  geometry::Rigid3 camera_from_head;  // mm
};

class FaceSynth {
 public:
  // Both models must have the same points in the same order; the appearance model needs a colour
  // texture. Throws std::invalid_argument.
  FaceSynth(const face::appearance::AppearanceModel& appearance, face::head::HeadModel head);

  [[nodiscard]] const face::head::HeadModel& head() const { return head_; }

  // A random person: normal distribution with the models' standard deviations times `spread`.
  [[nodiscard]] FacePerson person(std::uint64_t seed, double spread = 0.7) const;

  // Draws the person into `image` (CV_8UC3, of the camera's size). `seed`: of background and noise.
  // The image does not depend on the number of threads.
  FaceTruth draw(cv::Mat& image, const FacePerson& person, const geometry::Camera& camera,
                 const geometry::Rigid3& camera_from_head, const FaceSceneOptions& options,
                 std::uint64_t seed) const;

  // The head's surface, mm, in the head's frame, with its texture.
  [[nodiscard]] render::Mesh mesh(const FacePerson& person) const;

 private:
  [[nodiscard]] cv::Mat texture(const FacePerson& person) const;

  const face::appearance::AppearanceModel& appearance_;
  face::appearance::Synthesis synthesis_;
  face::head::HeadModel head_;
  cv::Mat outside_;  // CV_8UC1, 255 where the wide texture shows no face
  // CV_32S, for each pixel outside: index of the nearest pixel inside (y * cols + x).
  cv::Mat nearest_inside_;
  cv::Rect inner_;              // of the texture's frame in the wide texture
  Eigen::Matrix2Xd points_at_;  // of the points in the wide texture, px
  double px_per_mm_ = 1;        // scale from the front view of the mean head to the wide texture
  Eigen::Vector2d px_origin_;   // position of the head's origin there
};

}  // namespace tarsier::synth
