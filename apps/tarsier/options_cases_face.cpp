// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/appearance/start.h"
#include "tarsier/face/appearance/tracker.h"
#include "tarsier/face/appearance/training_image.h"
#include "tarsier/face/detect/anchor_detector.h"
#include "tarsier/face/detect/detector.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/detect/face_training.h"
#include "tarsier/face/head/blink.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head/liveness.h"
#include "tarsier/face/head/posit.h"
#include "tarsier/face/head/posit_study.h"
#include "tarsier/face/head/smoothing.h"
#include "tarsier/face/head/train_head.h"
#include "tarsier/face/head_view/view_train.h"
#include "tarsier/face/landmarks/adapt.h"
#include "tarsier/face/landmarks/alpha_beta_filter.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/face/landmarks/train_model.h"
#include "tarsier/face/people/classical.h"
#include "tarsier/face/people/collector.h"
#include "tarsier/face/people/eyes.h"
#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/people/group_merging.h"
#include "tarsier/face/people/quality.h"
#include "tarsier/face/people/sighting_groups.h"
#include "tarsier/face/pipelines/annotator.h"
#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/cell_index.h"
#include "tarsier/face/recognition/evaluation.h"
#include "tarsier/face/recognition/lbp.h"
#include "tarsier/face/recognition/normalize.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/gradient_features.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/face/regression/quality.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/regression/trees.h"
#include "tarsier/face/regression/visibility.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/face/train/face_turn.h"

#include "options_cases.h"

namespace tarsier::cli {

std::vector<OptionsCase> face_options() {
  return {
      options_case<face::appearance::FitOptions>("face::appearance::FitOptions"),
      options_case<face::appearance::AppearanceOptions>("face::appearance::AppearanceOptions"),
      options_case<face::appearance::SearchOptions>("face::appearance::SearchOptions"),
      options_case<face::appearance::TrackOptions>("face::appearance::TrackOptions"),
      options_case<face::appearance::LoadOptions>("face::appearance::LoadOptions"),
      options_case<face::AnchorSearchOptions>("face::AnchorSearchOptions"),
      options_case<face::FaceDetectorOptions>("face::FaceDetectorOptions"),
      options_case<face::FaceFollowerOptions>("face::FaceFollowerOptions"),
      options_case<face::FaceSearchOptions>("face::FaceSearchOptions"),
      options_case<face::FaceTrainingOptions>("face::FaceTrainingOptions"),
      options_case<face::head::BlinkOptions>("face::head::BlinkOptions"),
      options_case<face::head::HeadPoseOptions>("face::head::HeadPoseOptions"),
      options_case<face::head::LivenessOptions>("face::head::LivenessOptions"),
      options_case<face::head::PositOptions>("face::head::PositOptions"),
      options_case<face::head::PositStudyOptions>("face::head::PositStudyOptions"),
      options_case<face::head::OneEuroOptions>("face::head::OneEuroOptions"),
      options_case<face::head::TrainHeadOptions>("face::head::TrainHeadOptions"),
      options_case<face::head_view::TrainViewOptions>("face::head_view::TrainViewOptions"),
      options_case<face::landmarks::AdaptOptions>("face::landmarks::AdaptOptions"),
      options_case<face::regression::DescentOptions>("face::regression::DescentOptions"),
      options_case<face::regression::FeatureScale>("face::regression::FeatureScale"),
      options_case<face::landmarks::HogOptions>("face::landmarks::HogOptions"),
      options_case<face::regression::LoadOptions>("face::regression::LoadOptions"),
      options_case<face::regression::QualityOptions>("face::regression::QualityOptions"),
      options_case<face::landmarks::FitOptions>("face::landmarks::FitOptions"),
      options_case<face::regression::PatchOptions>("face::regression::PatchOptions"),
      options_case<face::regression::PatchFitOptions>("face::regression::PatchFitOptions"),
      options_case<face::regression::RegressionNetworkOptions>(
          "face::regression::RegressionNetworkOptions"),
      options_case<face::regression::VisibilityOptions>("face::regression::VisibilityOptions"),
      options_case<face::landmarks::AlphaBetaFilterOptions>(
          "face::landmarks::AlphaBetaFilterOptions"),
      options_case<face::landmarks::TrackerOptions>("face::landmarks::TrackerOptions"),
      options_case<face::landmarks::TrainModelOptions>("face::landmarks::TrainModelOptions"),
      options_case<face::regression::TreesOptions>("face::regression::TreesOptions"),
      options_case<face::people::ClassicalOptions>("face::people::ClassicalOptions"),
      options_case<face::people::CollectOptions>("face::people::CollectOptions"),
      options_case<face::people::CropOptions>("face::people::CropOptions"),
      options_case<face::people::FaceReaderOptions>("face::people::FaceReaderOptions"),
      options_case<face::people::GroupMergingOptions>("face::people::GroupMergingOptions"),
      options_case<face::people::GroupingOptions>("face::people::GroupingOptions"),
      options_case<face::people::QualityGate>("face::people::QualityGate"),
      options_case<face::AnnotatorOptions>("face::AnnotatorOptions"),
      options_case<face::IdentificationOptions>("face::IdentificationOptions"),
      options_case<face::recognition::BackgroundOptions>("face::recognition::BackgroundOptions"),
      options_case<face::recognition::CellIndexOptions>("face::recognition::CellIndexOptions"),
      options_case<face::recognition::EvaluationOptions>("face::recognition::EvaluationOptions"),
      options_case<face::recognition::LbpOptions>("face::recognition::LbpOptions"),
      options_case<face::recognition::TanTriggsOptions>("face::recognition::TanTriggsOptions"),
      options_case<face::recognition::DescriptorOptions>("face::recognition::DescriptorOptions"),
      options_case<face::recognition::RecognizerOptions>("face::recognition::RecognizerOptions"),
      options_case<face::shape::ShapeModelOptions>("face::shape::ShapeModelOptions"),
      options_case<face::train::CopyOptions>("face::train::CopyOptions"),
  };
}

}  // namespace tarsier::cli
