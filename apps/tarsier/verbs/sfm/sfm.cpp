// SPDX-License-Identifier: MIT
#include "verbs/sfm/sfm.h"

#include "tarsier/core/log.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/dense/dense_evaluation.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/surface/surface_evaluation.h"
#include "tarsier/sfm/surface/surface_files.h"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier::cli {
namespace {

struct SfmEvalFlags {
  std::string model;
  std::string truth;
  bool dense = false;
  std::string mesh;
  std::string errors;
};

std::string lines_of(const std::vector<sfm::ThresholdScore>& scores, double extent) {
  std::string text;
  for (const sfm::ThresholdScore& score : scores) {
    text += fmt::format(
        "within {:.2f} % of the extent ({:.4g}): accuracy {:.1f} %, completeness {:.1f} %, F1 "
        "{:.3f}\n",
        100 * score.threshold, extent * score.threshold, 100 * score.accuracy,
        100 * score.completeness, score.f1);
  }
  return text;
}

// Compares the surface with the true one, truth/mesh.ply.
sfm::SurfaceScores evaluate_mesh(const SfmEvalFlags& flags, const sfm::Workspace& truth,
                                 const sfm::Workspace& model, const Context& context) {
  const std::filesystem::path exact = std::filesystem::path(flags.truth) / "mesh.ply";
  std::error_code ignored;
  if (!std::filesystem::exists(exact, ignored))
    throw InputError(exact.string(), "is missing: write it with sfm synth --depth");
  sfm::SurfaceScores scores =
      sfm::evaluate_surface(truth, sfm::read_surface(exact.string()), sfm::read_surface(flags.mesh),
                            sfm::align_workspaces(truth, model), *context.progress, context.stop);
  if (!flags.errors.empty()) {
    make_folder(flags.errors);
    sfm::write_surface((std::filesystem::path(flags.errors) / "mesh.ply").string(),
                       {scores.errors, std::nullopt});
  }
  return scores;
}

ExitStatus evaluate_dense(const SfmEvalFlags& flags, const Context& context) {
  const sfm::Workspace truth = sfm::Workspace::open(flags.truth);
  const sfm::Workspace model = sfm::Workspace::open(flags.model);
  const auto show = [&](const std::string& name, const cv::Mat& image) {
    const std::filesystem::path path = std::filesystem::path(flags.errors) / (name + ".png");
    make_folder(path.parent_path().string());
    write_image(path.string(), image);
  };
  const sfm::DenseScores scores =
      flags.errors.empty()
          ? sfm::evaluate_dense(truth, model, {}, *context.progress, context.stop)
          : sfm::evaluate_dense(truth, model, show, *context.progress, context.stop);
  std::optional<sfm::SurfaceScores> mesh;
  if (!flags.mesh.empty()) mesh = evaluate_mesh(flags, truth, model, context);
  if (context.json) {
    nlohmann::ordered_json line = sfm::to_json(scores);
    if (mesh) line["mesh"] = sfm::to_json(*mesh);
    print_json(line);
    return ExitStatus::kDone;
  }
  std::string text;
  for (const auto& image : scores.images) {
    text += fmt::format("{:<20} depth error {:.3f} %, within 1 % {:.1f} %, known {:.1f} %\n",
                        image.name, 100 * image.median, 100 * image.within_one, 100 * image.known);
  }
  text += fmt::format("median depth error {:.4f} %\n", 100 * scores.depth_median);
  if (!scores.cloud.empty()) text += "cloud\n" + lines_of(scores.cloud, scores.extent);
  if (mesh) {
    text += fmt::format("mesh: median distance {:.4g}\n{}", mesh->distance_median,
                        lines_of(mesh->thresholds, mesh->extent));
  }
  print_text(text);
  return ExitStatus::kDone;
}

ExitStatus evaluate_model(const SfmEvalFlags& flags, const Context& context) {
  if (flags.dense) return evaluate_dense(flags, context);
  const sfm::Model model = sfm::read_colmap(flags.model);
  const sfm::PoseScores scores =
      sfm::evaluate_poses(model, sfm::read_pose_truth(flags.truth), flags.model);
  const nlohmann::ordered_json line = sfm::scores_json(scores, model);
  if (context.json) {
    print_json(line);
    return ExitStatus::kDone;
  }
  std::string text;
  for (const auto& [key, value] : line.items())
    text += fmt::format("{:<20} {}\n", key,
                        value.is_string() ? value.get<std::string>() : value.dump());
  print_text(text);
  return ExitStatus::kDone;
}

void add_eval_flags(Command& verb, SfmEvalFlags& flags) {
  verb.add_option("MODEL", flags.model, "model folder with cameras.txt, images.txt, points3D.txt")
      .required()
      .type_name("");
  verb.add_option("--truth,--gt", flags.truth,
                  "ground truth: JSON lines {\"name\",\"R\",\"C\"}, or a folder like MODEL")
      .required();
  Flag& dense =
      verb.add_flag("--dense", flags.dense,
                    "evaluate a folder of `sfm dense` against truth/ of `sfm synth --depth`");
  verb.add_option(
          "--mesh", flags.mesh,
          ".ply or .obj of `sfm mesh` to compare with truth/mesh.ply, in the units of MODEL")
      .needs(dense);
  verb.add_option("--errors", flags.errors,
                  "output folder for depth error images and the mesh coloured by error")
      .needs(dense);
}

}  // namespace

bool is_in_studio() { return std::getenv("TARSIER_STUDIO") != nullptr; }

void add_sfm(Command& app, Context& context) {
  Command& sfm = app.add_subcommand("sfm", "images to camera poses and a point cloud");
  sfm.require_subcommand(1);
  add_sfm_reconstruct(sfm, context);
  add_sfm_shards(sfm, context);
  add_sfm_dense(sfm, context);
  add_sfm_mesh(sfm, context);
  add_sfm_synth(sfm, context);
  add_verb<SfmEvalFlags>(sfm, "eval", "evaluate a model's poses against ground truth", context,
                         add_eval_flags, evaluate_model);
}

}  // namespace tarsier::cli
