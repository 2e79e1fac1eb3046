// SPDX-License-Identifier: MIT
#include "verbs/sfm/sfm.h"

#include "tarsier/core/log.h"
#include "tarsier/media/archive.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct EvalFlags {
  std::string model;
  std::string truth;
};

ExitStatus evaluate(const EvalFlags& flags, const Context& context) {
  const sfm::Model model = sfm::read_colmap(flags.model);
  const sfm::PoseScores scores =
      sfm::evaluate_poses(model, sfm::read_pose_truth(flags.truth), flags.model);
  const nlohmann::ordered_json json = sfm::scores_json(scores, model);
  if (context.json) {
    print_json(json);
    return ExitStatus::kDone;
  }
  std::string text;
  for (const auto& [key, value] : json.items())
    text += fmt::format("{:<20} {}\n", key,
                        value.is_string() ? value.get<std::string>() : value.dump());
  print_text(text);
  return ExitStatus::kDone;
}

void add_eval_flags(Command& verb, EvalFlags& flags) {
  verb.add_option("MODEL", flags.model, "folder with cameras.txt, images.txt, points3D.txt")
      .required()
      .type_name("");
  verb.add_option("--truth,--gt", flags.truth,
                  "lines of JSON {\"name\",\"R\",\"C\"}, or a folder like MODEL")
      .required();
}

}  // namespace

void add_sfm(Command& app, Context& context) {
  Command& sfm = app.add_subcommand("sfm", "images to camera poses and a point cloud");
  sfm.require_subcommand(1);
  add_sfm_reconstruct(sfm, context);
  add_sfm_synth(sfm, context);
  add_verb<EvalFlags>(sfm, "eval", "compares a model's poses with the truth", context,
                      add_eval_flags, evaluate);
}

}  // namespace tarsier::cli
