// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/options.h"
#include "tarsier/linalg/trainer.h"
#include "tarsier/media/crop_server.h"
#include "tarsier/media/event_command.h"
#include "tarsier/media/frame_sink.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/video_encoder.h"
#include "tarsier/mqtt/publisher.h"
#include "tarsier/plate/classic/candidates.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/classic.h"
#include "tarsier/plate/classic/mlp.h"
#include "tarsier/plate/classic/plate_svm.h"
#include "tarsier/plate/classic/segments.h"
#include "tarsier/plate/classic/study.h"
#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/reader/reader.h"
#include "tarsier/plate/site/site.h"
#include "tarsier/plate/text/decode.h"
#include "tarsier/plate/text/evaluation.h"
#include "tarsier/plate/tracking/log.h"
#include "tarsier/plate/tracking/recorder.h"
#include "tarsier/plate/tracking/tracker.h"
#include "tarsier/plate/tracking/vote.h"
#include "tarsier/plate/train/training.h"
#include "tarsier/plate/train/training_views.h"

#include "options_cases.h"
#include "ui/face/annotate_session.h"
#include "ui/face/people_session.h"
#include "ui/face/pose_session.h"

namespace tarsier::cli {

std::vector<OptionsCase> plate_options() {
  return {
      options_case<cartoon::SketchOptions>("cartoon::SketchOptions"),
      options_case<cartoon::PaintOptions>("cartoon::PaintOptions"),
      options_case<cartoon::EvilOptions>("cartoon::EvilOptions"),
      options_case<cartoon::SkinOptions>("cartoon::SkinOptions"),
      options_case<cartoon::SteadyOptions>("cartoon::SteadyOptions"),
      options_case<linalg::TrainOptions>("linalg::TrainOptions"),
      options_case<CropServerOptions>("CropServerOptions"),
      options_case<EventCommandOptions>("EventCommandOptions"),
      options_case<SinkOptions>("SinkOptions"),
      options_case<SourceOptions>("SourceOptions"),
      options_case<VideoEncoderOptions>("VideoEncoderOptions"),
      options_case<mqtt::PublisherOptions>("mqtt::PublisherOptions"),
      options_case<plate::CandidateOptions>("plate::CandidateOptions"),
      options_case<plate::CharacterReaderOptions>("plate::CharacterReaderOptions"),
      options_case<plate::ClassicOptions>("plate::ClassicOptions"),
      options_case<plate::MlpOptions>("plate::MlpOptions"),
      options_case<plate::PlateSvmOptions>("plate::PlateSvmOptions"),
      options_case<plate::SegmentOptions>("plate::SegmentOptions"),
      options_case<plate::StudyOptions>("plate::StudyOptions"),
      options_case<plate::DetectorOptions>("plate::DetectorOptions"),
      options_case<plate::RecognizerOptions>("plate::RecognizerOptions"),
      options_case<plate::ReaderOptions>("plate::ReaderOptions"),
      options_case<plate::DecodeOptions>("plate::DecodeOptions"),
      options_case<plate::ForgetOptions>("plate::ForgetOptions"),
      options_case<plate::MotionOptions>("plate::MotionOptions"),
      options_case<plate::SiteOptions>("plate::SiteOptions"),
      options_case<plate::EvaluationOptions>("plate::EvaluationOptions"),
      options_case<plate::RecorderOptions>("plate::RecorderOptions"),
      options_case<plate::TrackerOptions>("plate::TrackerOptions"),
      options_case<plate::ViewOptions>("plate::ViewOptions"),
      options_case<plate::VoteOptions>("plate::VoteOptions"),
      options_case<plate::TrainingOptions>("plate::TrainingOptions"),
      options_case<AnnotateOptions>("AnnotateOptions"),
      options_case<PeopleSessionOptions>("PeopleSessionOptions"),
      options_case<PoseSessionOptions>("PoseSessionOptions"),
  };
}

}  // namespace tarsier::cli
