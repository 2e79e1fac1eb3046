// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/synth/observed_site.h"
#include "tarsier/synth/sfm_scene.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "framework/bind.h"
#include "framework/size_flag.h"
#include "verbs/sfm/sfm.h"
#include "verbs/sfm/synth_truth.h"
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

struct SfmSynthFlags {
  std::string output;
  std::string size = "1024x768";
  std::string trajectory = "arc";
  std::string content;
  bool depth = false;
  bool observations = false;
  synth::SiteOptions site;
  synth::SceneOptions scene;
};

const std::map<std::string, synth::Trajectory> kTrajectories{
    {"arc", synth::Trajectory::kArc},   {"ring", synth::Trajectory::kRing},
    {"line", synth::Trajectory::kLine}, {"grid", synth::Trajectory::kGrid},
    {"walk", synth::Trajectory::kWalk}, {"city", synth::Trajectory::kCity}};
const std::map<std::string, synth::Content> kContents{
    {"relief", synth::Content::kRelief},   {"boxes", synth::Content::kBoxes},
    {"plane", synth::Content::kPlane},     {"repeated", synth::Content::kRepeated},
    {"nothing", synth::Content::kNothing}, {"room", synth::Content::kRoom},
    {"thin", synth::Content::kThin},       {"patchy", synth::Content::kPatchy},
    {"shiny", synth::Content::kShiny},     {"symmetric", synth::Content::kSymmetric},
    {"houses", synth::Content::kHouses},   {"temple", synth::Content::kTemple},
    {"toy", synth::Content::kToy}};

// Scenes that give observations only and are not rendered.
const std::map<std::string, synth::SiteKind> kSites{{"ring", synth::SiteKind::kRing},
                                                    {"grid", synth::SiteKind::kGrid},
                                                    {"walk", synth::SiteKind::kWalk},
                                                    {"city", synth::SiteKind::kCity},
                                                    {"symmetric", synth::SiteKind::kSymmetric}};

template <typename Map>
std::vector<std::string> names_of(const Map& map) {
  std::vector<std::string> names;
  for (const auto& [name, value] : map) names.push_back(name);
  return names;
}

nlohmann::ordered_json truth_line(const std::string& name, const geometry::Rigid3& pose) {
  nlohmann::ordered_json line{{"name", name}, {"R", geometry::row_major(pose.rotation)}};
  const Eigen::Vector3d center = pose.center();
  line["C"] = {center[0], center[1], center[2]};
  return line;
}

// Writes a COLMAP database with the observations of a scene, without images.
ExitStatus make_observations(SfmSynthFlags& flags, Context& context) {
  const auto kind = kSites.find(flags.trajectory);
  if (kind == kSites.end() || flags.depth) {
    throw UsageError(fmt::format("--observations needs --trajectory {}, without --depth",
                                 fmt::join(names_of(kSites), ", ")));
  }
  flags.site.kind = kind->second;
  flags.site.seed = context.seed;
  flags.site.images = flags.scene.images;
  flags.site.check();
  const fs::path folder = flags.output;
  make_folder(folder.string());
  const synth::ObservedSite site = [&] {
    const EndOnSignals at_once;
    return synth::make_observed_site(flags.site);
  }();
  geometry::write_camera_file((folder / "camera.yaml").string(), site.camera);
  sfm::ColmapDatabase database;
  database.cameras.push_back({site.camera, true});
  std::string truth;
  for (std::size_t i = 0; i < site.poses.size(); ++i) {
    sfm::ColmapDatabase::DatabaseImage image;
    image.name = fmt::format("{:06}.jpg", i);
    image.features.points = site.features[i];
    image.features.sizes.assign(site.features[i].size(), 5.F);
    const nlohmann::ordered_json line = truth_line(image.name, site.poses[i]);
    truth += line.dump() + "\n";
    if (context.json) print_json(line);
    database.images.push_back(std::move(image));
  }
  for (const auto& pair : site.pairs) {
    sfm::ColmapDatabase::DatabasePair known;
    known.first = pair.first;
    known.second = pair.second;
    for (const auto& [first, second] : pair.matches) known.matches.push_back({first, second});
    database.pairs.push_back(std::move(known));
  }
  sfm::write_colmap_database((folder / "database.db").string(), database);
  write_file_atomically((folder / "truth.jsonl").string(), truth);
  return ExitStatus::kDone;
}

bool is_symmetric(const std::string& content) {
  return content == "symmetric" || content == "temple" || content == "toy";
}

// Chooses the content where none is given, and rejects content that does not suit the trajectory.
void check_content(SfmSynthFlags& flags) {
  const bool in_streets = flags.trajectory == "walk" || flags.trajectory == "city";
  if (flags.content.empty()) flags.content = in_streets ? "houses" : "relief";
  if (in_streets != (flags.content == "houses")) {
    throw UsageError(in_streets ? fmt::format("--trajectory {} needs --content houses, not {}",
                                              flags.trajectory, flags.content)
                                : "--content houses needs --trajectory walk or city");
  }
  if (flags.trajectory == "grid" && flags.content != "relief" && flags.content != "boxes" &&
      flags.content != "plane")
    throw UsageError("--trajectory grid needs --content relief, boxes or plane");
  if (in_streets && flags.scene.pure_rotation)
    throw UsageError(
        fmt::format("--pure-rotation is not possible with --trajectory {}", flags.trajectory));
  if (in_streets && flags.scene.images < 2)
    throw UsageError(fmt::format("--trajectory {}: needs 2 images or more", flags.trajectory));
  if (in_streets && flags.depth)
    throw UsageError(fmt::format("--depth is not possible with --trajectory {}", flags.trajectory));
}

// Writes the images of a rendered scene, camera.yaml, and truth.jsonl for `sfm eval`.
ExitStatus make_scene(SfmSynthFlags& flags, Context& context) {
  if (flags.observations) return make_observations(flags, context);
  if (!kTrajectories.contains(flags.trajectory))
    throw UsageError(fmt::format("--trajectory {}: needs --observations", flags.trajectory));
  check_content(flags);
  flags.scene.size = parse_size(flags.size, 32, 8192);
  flags.scene.seed = context.seed;
  flags.scene.trajectory = kTrajectories.at(flags.trajectory);
  flags.scene.content = kContents.at(flags.content);
  if (is_symmetric(flags.content)) flags.scene.details = flags.site.details;
  flags.scene.repeats = flags.site.repeats;
  flags.scene.check();
  const auto scene = [&] {
    const EndOnSignals at_once;
    return synth::SfmScene(flags.scene);
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
    const nlohmann::ordered_json line = truth_line(name, scene.pose(i));
    truth += line.dump() + "\n";
    if (context.json) print_json(line);
    context.progress->advance();
  }
  context.progress->end();
  write_file_atomically((folder / "truth.jsonl").string(), truth);
  if (flags.depth) write_depth_truth((folder / "truth").string(), scene, context);
  return ExitStatus::kDone;
}

void add_flags(Command& verb, SfmSynthFlags& flags) {
  verb.add_option("-o,--output", flags.output, "output folder").required();
  bind_field(verb, flags.scene, flags.scene.images);
  verb.add_option("--size", flags.size, "image size, px").show_default();
  verb.add_option("--trajectory", flags.trajectory, "camera trajectory")
      .check(one_of({"arc", "ring", "line", "grid", "walk", "city", "symmetric"}))
      .show_default();
  verb.add_option("--content", flags.content,
                  "scene content [relief; houses with --trajectory walk or city]")
      .check(one_of(names_of(kContents)));
  bind_field(verb, flags.scene, flags.scene.noise);
  verb.add_flag("--depth", flags.depth,
                "also write truth/: exact cameras, points, depth maps and surface");
  verb.add_option("--focal", flags.scene.focal_px, "px, focal length; 0: the longer image side")
      .show_default();
  bind_field(verb, flags.scene, flags.scene.pure_rotation);
  verb.add_flag("--observations", flags.observations,
                "write features and matches to database.db instead of images, for `sfm reconstruct "
                "--database`");
  bind_all(verb, flags.site, "Observations, symmetric objects and streets");
}

}  // namespace

void add_sfm_synth(Command& sfm, Context& context) {
  add_verb<SfmSynthFlags>(
      sfm, "synth", "render images of a synthetic scene with known cameras, or only their features",
      context, add_flags, make_scene);
}

}  // namespace tarsier::cli
