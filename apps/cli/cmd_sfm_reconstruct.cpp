// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/words.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/still_source.h"
#include "tarsier/sfm/mapper/pairs.h"
#include "tarsier/sfm/mapper/pipeline.h"
#include "tarsier/sfm/mapper/report.h"
#include "tarsier/sfm/mapper/results.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/exif.h"
#include "tarsier/sfm/scene/keyframes.h"
#include "tarsier/sfm/scene/ply.h"
#include "tarsier/sfm/scene/undistort.h"
#include "tarsier/sfm/view/animation.h"
#include "tarsier/sfm/view/render.h"
#include "tarsier/sfm/view/viewer.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "cmd_sfm.h"
#include "sfm_online.h"
#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

struct ReconstructFlags {
  std::vector<std::string> inputs;
  std::string output;
  std::string camera;
  std::string camera_file;
  std::vector<std::string> refine;
  std::string features = "sift";
  double downscale = 1;
  std::string pairs = "auto";
  std::string matches = "sift";
  std::string align;
  double distance = 0;
  std::vector<std::string> distance_between;
  std::vector<std::string> exports;
  bool match_pictures = false;
  bool turntable = false;
  bool no_cache = false;
  bool per_image_camera = false;
  sfm::KeyframeOptions keyframes;
  OnlineFlags online;
  sfm::PipelineOptions pipeline;
};

// --- what takes part ---

// The name of an image in the model: its path within the folder, made unique elsewhere.
void add_inputs(const std::vector<std::string>& paths, std::set<std::string>& names,
                std::vector<sfm::Input>& inputs) {
  for (const std::string& path : paths) {
    const fs::path file(path);
    std::string name = file.filename().string();
    for (int k = 2; !names.insert(name).second; ++k)
      name = fmt::format("{}-{}{}", file.stem().string(), k, file.extension().string());
    inputs.push_back({name, path});
  }
}

std::string frames_folder(const ReconstructFlags& flags) {
  return (fs::path(flags.output) / "frames").string();
}

// Key frames of a video, written beside the model so that they are there for a second run and for
// whoever wants to see them.
std::vector<std::string> frames_of_video(const std::string& video, const ReconstructFlags& flags,
                                         Context& context) {
  const std::string folder = frames_folder(flags);
  make_folder(folder);
  const auto source = open_source(video, SourceOptions{});
  sfm::KeyframePicker picker(flags.keyframes);
  std::vector<std::string> paths;
  const auto keep = [&](std::optional<sfm::Keyframe> frame) {
    if (!frame) return;
    paths.push_back(key_frame_path(folder, *frame));
    write_image(paths.back(), frame->image);
  };
  context.progress->begin("key frames", source->count(), "frames");
  while (auto frame = source->next(std::chrono::milliseconds(1000), context.stop)) {
    throw_if_stopped(context.stop);
    keep(picker.offer(frame->image, frame->index, frame->time));
    context.progress->advance();
  }
  throw_if_stopped(context.stop);
  keep(picker.finish());
  context.progress->end();
  log_info("{}: {} key frames", video, paths.size());
  return paths;
}

std::vector<sfm::Input> inputs_of(const ReconstructFlags& flags, Context& context) {
  std::vector<sfm::Input> inputs;
  std::set<std::string> names;
  for (const std::string& text : flags.inputs) {
    switch (classify_source(text)) {
      case SourceKind::kFolder:
        add_inputs(pictures_in_folder(text), names, inputs);
        break;
      case SourceKind::kGlob:
        add_inputs(files_of_glob(text), names, inputs);
        break;
      case SourceKind::kList:
        add_inputs(paths_of_list(text.substr(1)), names, inputs);
        break;
      case SourceKind::kImage:
        add_inputs({text}, names, inputs);
        break;
      case SourceKind::kVideo:
        add_inputs(frames_of_video(text, flags, context), names, inputs);
        break;
      default:
        throw InputError(text,
                         "expected images, a folder, @list.txt or a video; a camera with --online");
    }
  }
  return inputs;
}

// As inputs_of, but they are shown, and a model of them, while they arrive.
OnlineResult inputs_online(const ReconstructFlags& flags, Context& context) {
  if (flags.pipeline.flow)
    throw UsageError("--online: compares descriptors, --matches flow is not possible");
  const auto is_picture = [](const std::string& text) {
    const SourceKind kind = classify_source(text, {synth::synth_scheme()});
    return kind == SourceKind::kImage || kind == SourceKind::kFolder || kind == SourceKind::kGlob ||
           kind == SourceKind::kList;
  };
  std::vector<sfm::Input> pictures;
  if (std::all_of(flags.inputs.begin(), flags.inputs.end(), is_picture)) {
    pictures = inputs_of(flags, context);
  } else if (flags.inputs.size() > 1) {
    throw UsageError("--online: give images, or one video or camera");
  }
  return run_online(flags.inputs, pictures, frames_folder(flags), flags.online, flags.keyframes,
                    flags.pipeline, context);
}

// --- options ---

void complete(ReconstructFlags& flags, const Context& context) {
  sfm::PipelineOptions& options = flags.pipeline;
  if (!flags.camera.empty() && !flags.camera_file.empty())
    throw UsageError("--camera and --camera-file: give one of them");
  if (!flags.camera.empty()) options.camera = geometry::parse_camera(flags.camera);
  if (!flags.camera_file.empty()) options.camera = geometry::read_camera_file(flags.camera_file);
  if (options.camera && options.camera->lens != geometry::Lens::kPinhole) {
    throw InputError(
        flags.camera_file.empty() ? flags.camera : flags.camera_file,
        fmt::format("is of a {} lens, and reconstruction takes pinhole ones: straighten "
                    "the images first (tarsier calibrate --undistorted)",
                    geometry::name_of(options.camera->lens)));
  }
  static const std::map<std::string, sfm::FeatureKind> kinds{{"sift", sfm::FeatureKind::kSift},
                                                             {"orb", sfm::FeatureKind::kOrb},
                                                             {"akaze", sfm::FeatureKind::kAkaze}};
  options.features.kind = kinds.at(flags.features);
  if (options.features.kind != sfm::FeatureKind::kSift) {
    options.matching.ratio = std::max(options.matching.ratio, 0.85);
    options.mapper.extend_similarity = 0.6;
  }
  if (!(flags.downscale >= 1 && flags.downscale <= 16))
    throw UsageError(fmt::format("--downscale {}: expected 1..16", flags.downscale));
  options.features.max_pixels /= flags.downscale * flags.downscale;
  static const std::map<std::string, sfm::PairChoice> choices{
      {"auto", sfm::PairChoice::kAuto},
      {"exhaustive", sfm::PairChoice::kExhaustive},
      {"sequential", sfm::PairChoice::kSequential},
      {"retrieval", sfm::PairChoice::kRetrieval}};
  if (const auto choice = choices.find(flags.pairs); choice != choices.end()) {
    options.pairs = choice->second;
  } else {
    options.pairs = sfm::PairChoice::kList;
    options.pairs_file = flags.pairs;
    if (!fs::exists(flags.pairs))
      throw UsageError(
          fmt::format("--pairs '{}': expected auto, exhaustive, sequential, retrieval "
                      "or a file with two names a line",
                      flags.pairs));
  }
  options.flow = flags.matches == "flow";
  options.shared_camera = !flags.per_image_camera;
  for (const std::string& what : flags.refine) {
    if (what == "focal") options.mapper.refine_focal = true;
    if (what == "center") options.mapper.refine_center = true;
    if (what == "distortion") options.mapper.refine_distortion = true;
    if (what == "none") options.fixed_camera = true;
  }
  if (!flags.no_cache) {
    options.cache_folder = (fs::path(flags.output) / "cache").string();
    make_folder(options.cache_folder);
  }
  options.seed = context.seed;
  options.check();
}

// --- what can be known before the work ---

using Positions = std::map<std::string, cv::Vec3d>;

// What errors of positions name.
std::string align_source(const ReconstructFlags& flags) {
  return flags.align == "gps" ? "--align gps" : flags.align;
}

Positions gps_positions(const std::vector<sfm::Input>& inputs, const Context& context) {
  std::vector<std::string> names;
  std::vector<cv::Vec3d> positions;
  for (const sfm::Input& input : inputs) {
    throw_if_stopped(context.stop);
    try {
      const auto gps = sfm::parse_exif(read_file(input.path, 512'000'000)).gps;
      if (!gps) continue;
      names.push_back(input.name);
      positions.push_back(*gps);
    } catch (const InputError&) {
      continue;  // is left out of the model with a warning
    }
  }
  const std::vector<cv::Vec3d> metres = sfm::local_metres(positions);
  Positions known;
  for (std::size_t i = 0; i < names.size(); ++i) known[names[i]] = metres[i];
  return known;
}

// Of the images that take part. Throws where they could place no model.
Positions positions_of(Positions known, const std::vector<sfm::Input>& inputs,
                       const ReconstructFlags& flags, const Context& context) {
  if (flags.align.empty()) return {};
  if (flags.align == "gps") known = gps_positions(inputs, context);
  Positions result;
  std::vector<cv::Vec3d> places;
  for (const sfm::Input& input : inputs) {
    const auto position = known.find(input.name);
    if (position == known.end()) continue;
    result.insert(*position);
    places.push_back(position->second);
  }
  if (places.size() < 3) {
    const std::string what =
        flags.align == "gps"
            ? fmt::format("{} of {} images have a position in EXIF", places.size(), inputs.size())
            : fmt::format("{} of {} names are images here (these are called '{}' ..)",
                          places.size(), known.size(), printable(inputs.front().name));
    throw InputError(align_source(flags), what + "; three that are not in a line are needed");
  }
  if (!sfm::similarity_between(places, places)) {
    throw InputError(align_source(flags),
                     fmt::format("the {} positions of images are in a line; three that are "
                                 "not are needed",
                                 places.size()));
  }
  if (places.size() < known.size()) {
    log_warning("{}: {} of {} names are no images here", flags.align, known.size() - places.size(),
                known.size());
  }
  return result;
}

void check_distance(const ReconstructFlags& flags) {
  if (flags.distance_between.empty()) {
    if (flags.distance != 0) throw UsageError("--distance needs --distance-between");
    return;
  }
  if (!(flags.distance > 0 && std::isfinite(flags.distance)))
    throw UsageError("--distance-between needs --distance, above 0");
  if (flags.distance_between[0] == flags.distance_between[1])
    throw UsageError("--distance-between: expected the names of two images");
}

// What would otherwise show when all the work is done.
void check_inputs(const std::vector<sfm::Input>& inputs, const ReconstructFlags& flags) {
  std::vector<std::string> names;
  for (const sfm::Input& input : inputs) {
    names.push_back(input.name);
    if (const std::string trouble = sfm::trouble_of_name(input.name); !trouble.empty())
      throw InputError(printable(input.path), trouble + ": rename it");
    if (!flags.exports.empty() && !is_image_path(input.name)) {
      throw InputError(input.path,
                       "--export undistorted writes images under their names, and of this "
                       "ending none is written: .jpg, .png, .webp, .bmp, .ppm");
    }
  }
  for (const std::string& name : flags.distance_between) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw UsageError(
          fmt::format("--distance-between: '{}' is no image here (these are "
                      "called '{}' ..)",
                      printable(name), printable(names.front())));
    }
  }
  if (flags.pipeline.pairs == sfm::PairChoice::kList)
    (void)sfm::read_pairs_list(flags.pipeline.pairs_file, names);
}

// --- scale and place ---

// Throws where the images that joined do not tell scale or place; the model is then as it was.
void place(sfm::Model& model, const ReconstructFlags& flags, const Positions& known,
           nlohmann::ordered_json& report) {
  std::vector<const sfm::Image*> ends;
  for (const std::string& name : flags.distance_between) {
    const auto image = std::find_if(model.images.begin(), model.images.end(),
                                    [&](const sfm::Image& each) { return each.name == name; });
    if (image == model.images.end() || !image->registered) {
      throw Error(ExitStatus::kBadInput,
                  fmt::format("--distance-between: '{}' is not in the model, which is written as "
                              "it is",
                              printable(name)));
    }
    ends.push_back(&*image);
  }
  const auto apart = [&] { return cv::norm(ends[0]->pose.center() - ends[1]->pose.center()); };
  if (!ends.empty() && !(apart() > 0)) {
    throw Error(
        ExitStatus::kBadInput,
        "--distance-between: both are at one place in the model, which is written as it is");
  }
  if (!flags.align.empty()) {
    std::vector<cv::Vec3d> from;
    std::vector<cv::Vec3d> to;
    for (const sfm::Image& image : model.images) {
      const auto position = known.find(image.name);
      if (!image.registered || position == known.end()) continue;
      from.push_back(image.pose.center());
      to.push_back(position->second);
    }
    const auto similarity = sfm::robust_similarity(from, to, 0, flags.pipeline.seed);
    if (!similarity) {
      throw InputError(align_source(flags),
                       fmt::format("{} positions fit images of the model; three that are not "
                                   "in a line are needed: the model is written as it is",
                                   from.size()));
    }
    sfm::transform(model, *similarity);
    double sum = 0;
    for (std::size_t i = 0; i < from.size(); ++i)
      sum += cv::norm(similarity->scale * (similarity->rotation * from[i]) +
                      similarity->translation - to[i]);
    report["aligned"] = {{"photographs", from.size()},
                         {"scale", similarity->scale},
                         {"mean_residual", sum / static_cast<double>(from.size())}};
  }
  if (!ends.empty()) {
    sfm::Similarity similarity;
    similarity.rotation = cv::Matx33d::eye();
    similarity.scale = flags.distance / apart();
    sfm::transform(model, similarity);
    report["scale"] = similarity.scale;
  }
}

// --- results ---

// Both images side by side: matches that were kept in green, removed ones in red. All as dots,
// as many with lines as can be told apart.
cv::Mat match_picture(const sfm::ComparedPair& pair) {
  constexpr double kMaxHeight = 600;
  constexpr std::size_t kMaxLines = 60;
  cv::Mat sides[2] = {read_image(pair.first.path), read_image(pair.second.path)};
  double scales[2];
  for (int k = 0; k < 2; ++k) {
    scales[k] = std::min(1.0, kMaxHeight / sides[k].rows);
    cv::resize(sides[k], sides[k], {}, scales[k], scales[k], cv::INTER_AREA);
  }
  cv::Mat picture(std::max(sides[0].rows, sides[1].rows), sides[0].cols + sides[1].cols, CV_8UC3,
                  cv::Scalar::all(255));
  sides[0].copyTo(picture(cv::Rect({0, 0}, sides[0].size())));
  sides[1].copyTo(picture(cv::Rect({sides[0].cols, 0}, sides[1].size())));
  std::set<int> kept;
  for (const sfm::Match& match : pair.view.inliers) kept.insert(match.first);
  for (const bool good : {false, true}) {
    const std::size_t all = good ? kept.size() : pair.matches.size() - kept.size();
    const std::size_t every = std::max<std::size_t>(1, all / kMaxLines);
    const cv::Scalar color = good ? cv::Scalar(80, 190, 60) : cv::Scalar(60, 60, 220);
    std::size_t number = 0;
    for (const sfm::Match& match : pair.matches) {
      if (kept.contains(match.first) != good) continue;
      const cv::Point2d a =
          cv::Point2d(pair.first_points[static_cast<std::size_t>(match.first)]) * scales[0];
      const cv::Point2d b =
          cv::Point2d(pair.second_points[static_cast<std::size_t>(match.second)]) * scales[1];
      const cv::Point2d beside = b + cv::Point2d(sides[0].cols, 0);
      cv::circle(picture, a, 2, color, cv::FILLED, cv::LINE_AA);
      cv::circle(picture, beside, 2, color, cv::FILLED, cv::LINE_AA);
      if (number++ % every == 0) cv::line(picture, a, beside, color, 1, cv::LINE_AA);
    }
  }
  return picture;
}

double camera_size(const sfm::Model& model) {
  cv::Vec3d low(1e300, 1e300, 1e300);
  cv::Vec3d high = -low;
  for (const sfm::Image& image : model.images) {
    if (!image.registered) continue;
    const cv::Vec3d center = image.pose.center();
    for (int k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], center[k]);
      high[k] = std::max(high[k], center[k]);
    }
  }
  return std::max(1e-6, 0.05 * cv::norm(high - low));
}

void write_turntable(const fs::path& path, const sfm::Model& model) {
  sfm::ViewOptions view;
  view.size = {640, 480};
  std::vector<cv::Mat> frames;
  sfm::render_turntable(model, view, 36,
                        [&](int, const cv::Mat& frame) { frames.push_back(frame.clone()); });
  sfm::write_gif(path.string(), frames, 12);
}

// The model itself.
void write_model(const fs::path& folder, const sfm::Model& model) {
  sfm::write_colmap(folder.string(), model);
  sfm::write_points_ply((folder / "points.ply").string(), model);
  sfm::write_cameras_ply((folder / "cameras.ply").string(), model, camera_size(model));
}

void write_views(const fs::path& folder, const sfm::Model& model) {
  write_file_atomically((folder / "view.html").string(), sfm::viewer_html(model, "Reconstruction"));
  write_image((folder / "view.png").string(), sfm::render_model(model, {}));
}

void write_extras(const fs::path& folder, const sfm::Model& model, const ReconstructFlags& flags,
                  const std::map<std::string, std::string>& paths, Context& context) {
  if (flags.turntable) write_turntable(folder / "turntable.gif", model);
  for (const std::string& what : flags.exports) {
    if (what != "undistorted") continue;
    sfm::export_undistorted((folder / "undistorted").string(), model,
                            [&](const std::string& name) { return read_image(paths.at(name)); },
                            *context.progress, context.stop);
  }
}

// Writes the models as soon as there are any, then scale and place, then what is made of them: what
// fails leaves what was made before it. Throws what placing threw when all is written.
void write_results(sfm::PipelineResult& result, const ReconstructFlags& flags,
                   const Positions& known, const std::map<std::string, std::string>& paths,
                   Context& context) {
  const fs::path folder = flags.output;
  std::vector<sfm::Model>& models = result.reconstruction.models;
  const bool interrupted = result.reconstruction.interrupted;
  nlohmann::ordered_json report = sfm::report_json(result);
  const auto write_report = [&] {
    write_file_atomically((folder / "report.json").string(), report.dump(1) + "\n");
  };
  std::exception_ptr misplaced;
  const auto earlier = sfm::earlier_run(folder.string());
  if (interrupted && earlier && !earlier->partial &&
      earlier->registered >= sfm::statistics_of(models.front()).registered) {
    log_warning("interrupted: {} keeps the finished model of an earlier run", flags.output);
  } else {
    for (std::size_t m = 0; m < models.size(); ++m) {
      const int number = static_cast<int>(m);
      if (m > 0) sfm::begin_model_folder(folder.string(), number);
      write_model(sfm::model_folder(folder.string(), number), models[m]);
    }
    write_report();
    if (!models.empty())
      sfm::remove_old_models(folder.string(), static_cast<int>(models.size()), earlier);
    if (!models.empty() && (!flags.align.empty() || !flags.distance_between.empty())) {
      try {
        nlohmann::ordered_json placed;
        place(models[0], flags, known, placed);
        report["placed"] = placed;
        write_model(folder, models[0]);
      } catch (const OutputError&) {
        throw;
      } catch (const Error& error) {
        report["not_placed"] = error.what();
        misplaced = std::current_exception();
      }
      write_report();
    }
    for (std::size_t m = 0; m < models.size(); ++m)
      write_views(sfm::model_folder(folder.string(), static_cast<int>(m)), models[m]);
  }
  if (context.json)
    print_json(report);
  else
    print_text(sfm::summary_text(result));
  if (!models.empty() && !misplaced) log_info("{}: look at view.html", flags.output);
  for (std::size_t m = 0; m < models.size() && !interrupted; ++m)
    write_extras(sfm::model_folder(folder.string(), static_cast<int>(m)), models[m], flags, paths,
                 context);
  if (misplaced) std::rethrow_exception(misplaced);
}

ExitStatus reconstruct(ReconstructFlags& flags, Context& context) {
  const fs::path folder = flags.output;
  make_folder(folder.string());
  { const AtomicFile writable((folder / "report.json").string()); }  // throws where it is not
  complete(flags, context);
  check_distance(flags);
  Positions known;
  if (!flags.align.empty() && flags.align != "gps") known = sfm::read_positions_csv(flags.align);
  OnlineResult online;
  if (flags.online.online) {
    online = inputs_online(flags, context);
    if (context.stop.stop_requested()) {
      log_info("making the model of {} key frames; once more ends at once", online.inputs.size());
      context.stop = {};
    }
  }
  const std::vector<sfm::Input> inputs =
      flags.online.online ? online.inputs : inputs_of(flags, context);
  std::map<std::string, std::string> paths;
  for (const sfm::Input& input : inputs) paths[input.name] = input.path;
  if (inputs.size() < 2) {
    throw InputError(flags.inputs.front(),
                     fmt::format("{} image{}; a reconstruction needs two or more", inputs.size(),
                                 inputs.size() == 1 ? "" : "s"));
  }

  check_inputs(inputs, flags);
  known = positions_of(std::move(known), inputs, flags, context);

  sfm::PipelineHooks hooks;
  hooks.partial = true;
  if (!context.debug_dir.empty()) {
    make_folder(context.debug_dir);
    hooks.watch = [&](const std::string& label, const sfm::Model& model) {
      const fs::path path = fs::path(context.debug_dir) / label;
      sfm::write_points_ply(path.string() + ".ply", model);
      write_image(path.string() + ".png", sfm::render_model(model, {}));
    };
  }
  if (flags.match_pictures) {
    make_folder((folder / "matches").string());
    hooks.on_pair = [&](const sfm::ComparedPair& pair) {
      if (pair.matches.empty()) return;
      const std::string name = fmt::format("{}-{}.jpg", fs::path(pair.first.name).stem().string(),
                                           fs::path(pair.second.name).stem().string());
      write_image((folder / "matches" / name).string(), match_picture(pair));
    };
  }
  sfm::PipelineResult result =
      sfm::run_pipeline(inputs, flags.pipeline, *context.progress, context.stop, hooks);
  write_results(result, flags, known, paths, context);
  if (result.reconstruction.interrupted) return ExitStatus::kInterrupted;
  if (online.error) std::rethrow_exception(online.error);
  if (online.status != ExitStatus::kDone) return online.status;
  return result.reconstruction.models.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_flags(Command& verb, ReconstructFlags& flags) {
  verb.add_option("PHOTOS", flags.inputs,
                  "folder, images, glob, @list.txt, or a video; with --online also a camera")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output, "folder for the model").required();
  const auto lens = [](Flag& flag) { flag.group("Lens"); };
  lens(verb.add_option("--camera", flags.camera, "fx,fy,cx,cy[,k1,k2,p1,p2[,k3]], px"));
  lens(verb.add_option("--camera-file", flags.camera_file,
                       "camera.yaml, OpenCV's YAML, COLMAP's cameras.txt"));
  lens(verb.add_option("--refine", flags.refine, "focal, center, distortion; or none")
           .delimiter(',')
           .check(one_of({"focal", "center", "distortion", "none"})));
  lens(verb.add_flag("--ignore-exif", flags.pipeline.ignore_exif,
                     "guess the focal length even where EXIF tells it"));
  lens(verb.add_flag("--per-image-camera", flags.per_image_camera,
                     "a camera for each image, not one for all of a size"));
  const auto match = [](Flag& flag) { flag.group("Features and matches"); };
  match(verb.add_option("--features", flags.features, "sift, orb, akaze")
            .check(one_of({"sift", "orb", "akaze"}))
            .show_default());
  match(verb.add_option("--max-features", flags.pipeline.features.most,
                        "features of an image, at most")
            .show_default());
  match(verb.add_option("--contrast", flags.pipeline.features.contrast,
                        "least, of SIFT, share of the grey range")
            .show_default());
  match(verb.add_option("--downscale", flags.downscale, "look at images reduced by this")
            .show_default());
  match(verb.add_option("--pairs", flags.pairs,
                        "auto, exhaustive, sequential, retrieval, or a file with two names a line")
            .show_default());
  match(verb.add_option("--overlap", flags.pipeline.overlap,
                        "images that each is matched with, of --pairs sequential")
            .show_default());
  match(verb.add_option("--nearest", flags.pipeline.nearest,
                        "images that each is matched with, of --pairs retrieval")
            .show_default());
  match(verb.add_option("--matches", flags.matches,
                        "sift: descriptors; flow: follow points from frame to frame")
            .check(one_of({"sift", "flow"}))
            .show_default());
  match(verb.add_option("--ratio", flags.pipeline.matching.ratio, "of the two best distances")
            .show_default());
  match(verb.add_option("--epipolar-px", flags.pipeline.two_view.threshold_px, "of an inlier")
            .show_default());
  const auto map = [](Flag& flag) { flag.group("Mapping"); };
  map(verb.add_option("--reprojection-px", flags.pipeline.mapper.reprojection_px,
                      "px; an observation farther off is dropped")
          .show_default());
  map(verb.add_option("--min-angle", flags.pipeline.mapper.min_angle_deg,
                      "between a point's rays, degrees")
          .show_default());
  map(verb.add_option("--min-views", flags.pipeline.mapper.min_views,
                      "images that show a point of the result")
          .show_default());
  const auto out = [](Flag& flag) { flag.group("Result"); };
  out(verb.add_option("--align", flags.align,
                      "name,x,y,z lines with where images were taken; or gps: from EXIF"));
  out(verb.add_option("--distance", flags.distance,
                      "between two cameras, in any unit: the model's from then on [none]"));
  out(verb.add_option("--distance-between", flags.distance_between, "their images' names")
          .expected(2));
  out(verb.add_option("--export", flags.exports, "undistorted: images and model for dense tools")
          .check(one_of({"undistorted"})));
  out(verb.add_flag("--turntable", flags.turntable, "turntable.gif: the cloud, turning"));
  out(verb.add_flag("--match-pictures", flags.match_pictures,
                    "matches/: each pair, kept green, removed red"));
  out(verb.add_flag("--no-cache", flags.no_cache, "keep nothing for a second run"));
  out(verb.add_option("--checkpoint", flags.pipeline.checkpoint_s,
                      "seconds between checkpoints of the mapping; 0: at each step")
          .check(range(0.0, 1e6))
          .show_default());
  const auto video = [](Flag& flag) { flag.group("Videos"); };
  video(verb.add_option("--key-motion", flags.keyframes.min_motion,
                        "of the picture's diagonal, between key frames")
            .show_default());
  video(verb.add_option("--max-frames", flags.keyframes.most, "key frames").show_default());
  add_online_flags(verb, flags.online);
}

}  // namespace

void add_sfm_reconstruct(Command& sfm, Context& context) {
  add_debug_flag(
      add_verb<ReconstructFlags>(sfm, "reconstruct", "makes a model of images: cameras and points",
                                 context, add_flags, reconstruct),
      context);
}

}  // namespace tarsier::cli
