// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/import.h"
#include "tarsier/face/shape/landmark_set.h"

#include "framework/cli.h"
#include <string>
#include <vector>

// One file a verb: cmd_landmarks_<verb>.cpp.
namespace tarsier::cli {

void add_landmarks_annotate(Command& area, Context& context);
void add_landmarks_import(Command& area, Context& context);
void add_landmarks_show(Command& area, Context& context);
void add_landmarks_train(Command& area, Context& context);
void add_landmarks_fit(Command& area, Context& context);
void add_landmarks_track(Command& area, Context& context);
void add_landmarks_eval(Command& area, Context& context);
void add_landmarks_adapt(Command& area, Context& context);

// Verbs of `train`.
void add_landmarks_train_detector(Command& parent, Context& context);
void add_landmarks_train_networks(Command& parent, Context& context);

// A set as it is given to train and eval: our own file, or whatever `landmarks import` takes.
// What had to be left out is logged.
struct SetFlags {
  std::string input;
  double offset = 0;   // --offset
  std::string images;  // --images
};
void add_set_flags(Command& verb, SetFlags& flags);

// Of the verbs that learn from a set.
struct TrainingFlags {
  SetFlags set;
  std::string output;  // --output
  std::string terms;   // --terms
  int hold_out = 0;    // --hold-out
};
// `eval`: the verb that judges on the samples held out.
void add_training_flags(Command& verb, TrainingFlags& flags,
                        std::string_view eval = "landmarks eval");

[[nodiscard]] face::shape::LandmarkSet load_set(const SetFlags& flags);

// Every `every`-th sample (3: the third, sixth ..), or all others. 0: all samples.
enum class Part { kHeldOut, kOthers };
[[nodiscard]] face::shape::LandmarkSet part_of(const face::shape::LandmarkSet& set, int every,
                                               Part part);

// The boxes of a dlib .xml file, or those around the landmarks of a set.
[[nodiscard]] std::vector<face::shape::BoxedImage> load_boxes(const SetFlags& flags, int every,
                                                              Part part);

// Images without the object, in the order of their names. Throws InputError for an empty folder.
void add_images_without(const std::string& folder, std::vector<face::shape::BoxedImage>& images);

}  // namespace tarsier::cli
