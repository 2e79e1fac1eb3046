// SPDX-License-Identifier: MIT
#include "verbs/landmarks/landmarks.h"

namespace tarsier::cli {

void add_landmarks(Command& app, Context& context) {
  Command& area = app.add_subcommand(
      "landmarks", "landmarks of faces and other objects: annotate, train, fit, track");
  area.require_subcommand(1);
  add_landmarks_annotate(area, context);
  add_landmarks_import(area, context);
  add_landmarks_show(area, context);
  add_landmarks_train(area, context);
  add_landmarks_fit(area, context);
  add_landmarks_track(area, context);
  add_landmarks_adapt(area, context);
  add_landmarks_eval(area, context);
}

}  // namespace tarsier::cli
