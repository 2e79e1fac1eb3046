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

// Heads that nobody has, with exact truth: a sample of the 3D head model (where the points are) and
// of an appearance model (what it looks like), seen by a camera in a known pose. Around the points'
// mesh, which ends at the brows, stand a plain skull, hair and neck, so that detectors see a head.
namespace tarsier::synth {

struct FacePerson {
  Eigen::VectorXd b;           // of the head model, mm; may be shorter than it has modes
  Eigen::VectorXd c;           // of the appearance model's colour texture; may be shorter
  cv::Vec3b hair{40, 45, 55};  // BGR
};

struct FaceSceneOptions {
  double ambient = 0.75;    // light from everywhere
  double diffuse = 0.35;    // light from one side
  double light_yaw = -30;   // degrees, where it comes from; + image right
  double noise = 2;         // standard deviation, grey levels
  double blur_px = 0.6;     // standard deviation
  bool with_ground = true;  // a smooth random background; else the image's own

  [[nodiscard]] OptionFields fields() {
    return {{"ambient", ambient, range(0, 2)},
            {"diffuse", diffuse, range(0, 2)},
            {"light_yaw", light_yaw, range(-90, 90)},
            {"noise", noise, range(0, 50), "--noise", "grey levels"},
            {"blur_px", blur_px, range(0, 20), "--blur", "px"}};
  }
  void check() const { check_fields(*this); }
};

struct FaceTruth {
  Eigen::Matrix2Xd points;            // 2 x n, px
  geometry::Rigid3 camera_from_head;  // mm
};

class FaceSynth {
 public:
  // Both models of the same points, in the same order; the appearance model with a colour texture.
  // Throws std::invalid_argument.
  FaceSynth(const face::appearance::AppearanceModel& appearance, face::head::HeadModel head);

  [[nodiscard]] const face::head::HeadModel& head() const { return head_; }

  // A random person: normal with the models' deviations times `spread`.
  [[nodiscard]] FacePerson person(std::uint64_t seed, double spread = 0.7) const;

  // Draws the person into `image` (CV_8UC3, of the camera's size). `seed` of ground and noise.
  // Same image for any number of threads.
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
  cv::Mat outside_;       // CV_8UC1, 255 where the wide texture shows no face
  cv::Mat shore_;         // CV_32S, for each pixel outside the nearest one inside (y * cols + x)
  cv::Rect inner_;        // of the texture's frame in the wide texture
  Eigen::Matrix2Xd at_;   // of the points in the wide texture, px
  double px_per_mm_ = 1;  // front view of the mean head onto the wide texture
  Eigen::Vector2d px_origin_;  // where the head's origin lies there
};

}  // namespace tarsier::synth
