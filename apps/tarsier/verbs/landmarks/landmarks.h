// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/import.h"
#include "tarsier/face/shape/landmark_set.h"

#include "framework/cli.h"
#include <array>
#include <string>
#include <vector>

// One file per verb: cmd_landmarks_<verb>.cpp.
namespace tarsier::cli {

void add_landmarks_annotate(Command& area, Context& context);
void add_landmarks_import(Command& area, Context& context);
void add_landmarks_show(Command& area, Context& context);
void add_landmarks_train(Command& area, Context& context);
void add_landmarks_fit(Command& area, Context& context);
void add_landmarks_track(Command& area, Context& context);
void add_landmarks_eval(Command& area, Context& context);
void add_landmarks_adapt(Command& area, Context& context);

// Sub-verbs of `train`.
void add_landmarks_train_detector(Command& parent, Context& context);
void add_landmarks_train_networks(Command& parent, Context& context);

// The landmark set for train and eval: a file of Tarsier, or any input of `landmarks import`.
// Skipped samples are logged.
struct SetFlags {
  std::string input;
  double offset = 0;   // --offset
  std::string images;  // --images
};
void add_set_flags(Command& verb, SetFlags& flags);

// The flags of verbs that train on a set.
struct TrainingFlags {
  SetFlags set;
  std::string output;  // --output
  std::string terms;   // --terms
  int hold_out = 0;    // --hold-out
};
// `eval` is the verb that evaluates on the held-out samples.
void add_training_flags(Command& verb, TrainingFlags& flags,
                        std::string_view eval = "landmarks eval");

[[nodiscard]] face::shape::LandmarkSet load_set(const SetFlags& flags);

// The outer eye corners, whose distance normalises errors: those of --eyes, or if `eyes` is empty
// those of the known markup of that many points. Throws UsageError.
[[nodiscard]] std::array<int, 2> outer_eyes_of(const std::vector<int>& eyes, int points);

// Selects every `every`-th sample (3: the third, sixth ..) or all others. 0 selects all samples.
enum class Part { kHeldOut, kOthers };
[[nodiscard]] face::shape::LandmarkSet part_of(const face::shape::LandmarkSet& set, int every,
                                               Part part);

// The boxes of a dlib .xml file, or the bounding boxes of a set's landmarks.
[[nodiscard]] std::vector<face::shape::BoxedImage> load_boxes(const SetFlags& flags, int every,
                                                              Part part);

// Adds images without the object, in the order of their names. Throws InputError for an empty
// folder.
void add_images_without(const std::string& folder, std::vector<face::shape::BoxedImage>& images);

}  // namespace tarsier::cli
