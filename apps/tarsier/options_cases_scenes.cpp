// SPDX-License-Identifier: MIT
#include "tarsier/geometry/planar_track.h"
#include "tarsier/planar/augment/augment.h"
#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/collector.h"
#include "tarsier/planar/calibration/detect.h"
#include "tarsier/planar/image_targets/detect.h"
#include "tarsier/planar/image_targets/features.h"
#include "tarsier/planar/image_targets/track.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/planar/markers/align.h"
#include "tarsier/planar/markers/decode.h"
#include "tarsier/planar/markers/detector.h"
#include "tarsier/planar/markers/outlines.h"
#include "tarsier/planar/markers/quads.h"
#include "tarsier/planar/pipelines/calibrator.h"
#include "tarsier/planar/pipelines/marker_tracker.h"
#include "tarsier/planar/sheets/sheet.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/bundle/bundle_solver.h"
#include "tarsier/sfm/dense/dense_reconstructor.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/flow.h"
#include "tarsier/sfm/features/matching.h"
#include "tarsier/sfm/features/pairs.h"
#include "tarsier/sfm/features/sift.h"
#include "tarsier/sfm/global/positioning.h"
#include "tarsier/sfm/global/rotation_averaging.h"
#include "tarsier/sfm/global/view_graph_clusters.h"
#include "tarsier/sfm/joining/join_models.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/pipelines/online.h"
#include "tarsier/sfm/pipelines/online_reconstructor.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/scene/keyframes.h"
#include "tarsier/sfm/surface/surface_reconstructor.h"
#include "tarsier/sfm/two_view/robust_two_view.h"
#include "tarsier/sfm/two_view/two_view.h"
#include "tarsier/sfm/view/render.h"
#include "tarsier/synth/face/synth_face.h"
#include "tarsier/synth/observed_site.h"
#include "tarsier/synth/planar_worlds.h"
#include "tarsier/synth/plates.h"
#include "tarsier/synth/sfm_scene.h"
#include "tarsier/synth/street.h"

#include "options_cases.h"

namespace tarsier::cli {

std::vector<OptionsCase> scene_options() {
  return {
      options_case<geometry::PlanarTrackOptions>("geometry::PlanarTrackOptions"),
      options_case<planar::augment::AugmentOptions>("planar::augment::AugmentOptions"),
      options_case<planar::calibration::CalibrateOptions>("planar::calibration::CalibrateOptions"),
      options_case<planar::calibration::CollectorOptions>("planar::calibration::CollectorOptions"),
      options_case<planar::calibration::FindOptions>("planar::calibration::FindOptions"),
      options_case<planar::image_targets::AlignOptions>("planar::image_targets::AlignOptions"),
      options_case<planar::image_targets::HomographyFitOptions>(
          "planar::image_targets::HomographyFitOptions"),
      options_case<planar::image_targets::MatchOptions>("planar::image_targets::MatchOptions"),
      options_case<planar::image_targets::DetectOptions>("planar::image_targets::DetectOptions"),
      options_case<planar::image_targets::FeatureOptions>("planar::image_targets::FeatureOptions"),
      options_case<planar::image_targets::TrackOptions>("planar::image_targets::TrackOptions"),
      options_case<planar::image_targets::TrainOptions>("planar::image_targets::TrainOptions"),
      options_case<planar::markers::AlignOptions>("planar::markers::AlignOptions"),
      options_case<planar::markers::DecodeOptions>("planar::markers::DecodeOptions"),
      options_case<planar::markers::DetectOptions>("planar::markers::DetectOptions"),
      options_case<planar::markers::OutlineOptions>("planar::markers::OutlineOptions"),
      options_case<planar::markers::QuadOptions>("planar::markers::QuadOptions"),
      options_case<planar::markers::RefineOptions>("planar::markers::RefineOptions"),
      options_case<planar::CalibratorOptions>("planar::CalibratorOptions"),
      options_case<planar::MarkerTrackerOptions>("planar::MarkerTrackerOptions"),
      options_case<planar::sheets::SheetOptions>("planar::sheets::SheetOptions"),
      options_case<sfm::DenseOptions>("sfm::DenseOptions"),
      options_case<sfm::DepthFilterOptions>("sfm::DepthFilterOptions"),
      options_case<sfm::FusionOptions>("sfm::FusionOptions"),
      options_case<sfm::PatchMatchOptions>("sfm::PatchMatchOptions"),
      options_case<sfm::ViewSelectionOptions>("sfm::ViewSelectionOptions"),
      options_case<sfm::BundleOptions>("sfm::BundleOptions"),
      options_case<sfm::BundleSolverOptions>("sfm::BundleSolverOptions"),
      options_case<sfm::ClusterOptions>("sfm::ClusterOptions"),
      options_case<sfm::FeatureOptions>("sfm::FeatureOptions"),
      options_case<sfm::FlowOptions>("sfm::FlowOptions"),
      options_case<sfm::JoinOptions>("sfm::JoinOptions"),
      options_case<sfm::MapperOptions>("sfm::MapperOptions"),
      options_case<sfm::MatchOptions>("sfm::MatchOptions"),
      options_case<sfm::OnlineOptions>("sfm::OnlineOptions"),
      options_case<sfm::PositioningOptions>("sfm::PositioningOptions"),
      options_case<sfm::RotationAveragingOptions>("sfm::RotationAveragingOptions"),
      options_case<sfm::RetrievalOptions>("sfm::RetrievalOptions"),
      options_case<sfm::RobustOptions>("sfm::RobustOptions"),
      options_case<sfm::SiftOptions>("sfm::SiftOptions"),
      options_case<sfm::PipelineOptions>("sfm::PipelineOptions"),
      options_case<sfm::TwoViewOptions>("sfm::TwoViewOptions"),
      options_case<sfm::OnlineReconstructorOptions>("sfm::OnlineReconstructorOptions"),
      options_case<sfm::KeyframeOptions>("sfm::KeyframeOptions"),
      options_case<sfm::SurfaceOptions>("sfm::SurfaceOptions"),
      options_case<sfm::VolumeOptions>("sfm::VolumeOptions"),
      options_case<sfm::ViewOptions>("sfm::ViewOptions"),
      options_case<synth::FaceSceneOptions>("synth::FaceSceneOptions"),
      options_case<synth::PlateFaceOptions>("synth::PlateFaceOptions"),
      options_case<synth::StillOptions>("synth::StillOptions"),
      options_case<synth::VideoOptions>("synth::VideoOptions"),
      options_case<synth::SceneOptions>("synth::SceneOptions"),
      options_case<synth::SiteOptions>("synth::SiteOptions"),
      options_case<synth::StreetOptions>("synth::StreetOptions"),
  };
}

}  // namespace tarsier::cli
