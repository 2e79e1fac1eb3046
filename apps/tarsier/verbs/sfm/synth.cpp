// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/relief.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/size_flag.h"
#include "verbs/sfm/sfm.h"
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

struct SynthFlags {
  std::string output;
  std::string size = "1024x768";
  std::string trajectory = "arc";
  std::string content = "relief";
  synth::SceneOptions scene;
};

const std::map<std::string, synth::Trajectory> kTrajectories{{"arc", synth::Trajectory::kArc},
                                                             {"ring", synth::Trajectory::kRing},
                                                             {"line", synth::Trajectory::kLine}};
const std::map<std::string, synth::Content> kContents{{"relief", synth::Content::kRelief},
                                                      {"boxes", synth::Content::kBoxes},
                                                      {"plane", synth::Content::kPlane},
                                                      {"repeated", synth::Content::kRepeated},
                                                      {"nothing", synth::Content::kNothing}};

template <typename Map>
std::vector<std::string> names_of(const Map& map) {
  std::vector<std::string> names;
  for (const auto& [name, value] : map) names.push_back(name);
  return names;
}

// Images of a drawn scene, camera.yaml, and truth.jsonl for `sfm eval`.
ExitStatus make_scene(SynthFlags& flags, Context& context) {
  flags.scene.size = parse_size(flags.size, 32, 8192);
  flags.scene.seed = context.seed;
  flags.scene.trajectory = kTrajectories.at(flags.trajectory);
  flags.scene.content = kContents.at(flags.content);
  flags.scene.check();
  const auto scene = [&] {
    const EndOnSignals at_once;
    return synth::ReliefScene(flags.scene);
  }();
  const fs::path folder = flags.output;
  make_folder((folder / "images").string());
  geometry::write_camera_file((folder / "camera.yaml").string(), scene.camera());
  std::string truth;
  context.progress->begin("synth", scene.count(), "images");
  for (int i = 0; i < scene.count(); ++i) {
    throw_if_stopped(context.stop);
    const std::string name = fmt::format("{:04}.jpg", i);
    write_image((folder / "images" / name).string(), scene.render(i, context.stop), 95);
    const geometry::Rigid3 pose = scene.pose(i);
    nlohmann::ordered_json line{{"name", name}, {"R", geometry::row_major(pose.rotation)}};
    const Eigen::Vector3d center = pose.center();
    line["C"] = {center[0], center[1], center[2]};
    truth += line.dump() + "\n";
    if (context.json) print_json(line);
    context.progress->advance();
  }
  context.progress->end();
  write_file_atomically((folder / "truth.jsonl").string(), truth);
  return ExitStatus::kDone;
}

void add_flags(Command& verb, SynthFlags& flags) {
  verb.add_option("-o,--output", flags.output, "folder").required();
  bind_field(verb, flags.scene, flags.scene.images);
  verb.add_option("--size", flags.size, "px").show_default();
  verb.add_option("--trajectory", flags.trajectory, "of the camera")
      .check(one_of(names_of(kTrajectories)))
      .show_default();
  verb.add_option("--content", flags.content, "what there is to see")
      .check(one_of(names_of(kContents)))
      .show_default();
  bind_field(verb, flags.scene, flags.scene.noise);
  verb.add_option("--focal", flags.scene.focal_px, "px; 0: the larger side").show_default();
  bind_field(verb, flags.scene, flags.scene.pure_rotation);
}

}  // namespace

void add_sfm_synth(Command& sfm, Context& context) {
  add_verb<SynthFlags>(sfm, "synth",
                       "draws images of a scene with known cameras: "
                       "images/, camera.yaml, truth.jsonl",
                       context, add_flags, make_scene);
}

}  // namespace tarsier::cli
