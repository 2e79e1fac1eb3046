// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/pipeline.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/mapper/cache.h"
#include "tarsier/sfm/mapper/center_uncertainty.h"
#include "tarsier/sfm/mapper/colmap_database.h"
#include "tarsier/sfm/mapper/flow.h"
#include "tarsier/sfm/mapper/image_features.h"
#include "tarsier/sfm/mapper/mapped_store.h"
#include "tarsier/sfm/mapper/start_model.h"
#include "tarsier/sfm/mapper/strong_pairs.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/sensor_image.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kGoodTrust = 0.9;
// Changes of the logarithm of a focal length:
constexpr double kMinRemapChange = 0.15;  // the old value was wrong
constexpr double kMinReevaluateChange = 0.02;

class Stages {
 public:
  Stages(PipelineResult& result, Progress& progress) : result_(result), progress_(progress) {}
  void begin(const char* name, std::int64_t total, const char* unit) {
    progress_.begin(name, total, unit);
    start(name);
  }
  void end() {
    progress_.end();
    record();
  }
  // As above, for a stage with its own progress.
  void start(const char* name) {
    name_ = name;
    start_ = std::chrono::steady_clock::now();
    cpu_start_ = cpu_seconds();
  }
  void record() {
    result_.stages.push_back(
        {name_, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(),
         cpu_seconds() - cpu_start_});
  }

 private:
  static double cpu_seconds() {
    timespec now{};
    if (clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) != 0) return 0;
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }

  PipelineResult& result_;
  Progress& progress_;
  std::string name_;
  std::chrono::steady_clock::time_point start_;
  double cpu_start_ = 0;
};

// Cache key of tracked points: the bytes of all files, in their order.
std::string flow_key(const std::vector<Input>& inputs, const std::stop_token& stop) {
  const FlowOptions flow;
  std::string text = fmt::format("flow {} {} {} {} {}", flow.max_points, flow.grid, flow.reach,
                                 flow.back_px, flow.min_correlation);
  for (const Input& input : inputs) {
    throw_if_stopped(stop);
    text += ' ';
    try {
      text += sha256_of_file(input.path);
    } catch (const InputError&) {
      text += "none";
    }
  }
  return cache_key(text);
}

// The content of a COLMAP database about the images.
class KnownFeatures {
 public:
  explicit KnownFeatures(const std::string& path)
      : database_(read_colmap_database(path)), sum_(sha256_of_file(path)), path_(path) {
    for (std::size_t i = 0; i < database_.images.size(); ++i)
      index_[database_.images[i].name] = static_cast<int>(i);
  }

  // Throws InputError where the database does not contain the image, or another image under its
  // name. With an empty image there is no file, and the data come from the database alone.
  void fill(const Input& input, const cv::Mat& image, ImageFeatures& features,
            const PipelineOptions& options) {
    const auto found = index_.find(input.name);
    if (found == index_.end())
      throw InputError(input.path.empty() ? input.name : input.path,
                       fmt::format("{} contains no image with this name", path_));
    auto& known = database_.images[at(found->second)];
    const auto& camera = database_.cameras[at(known.camera)];
    if (image.empty()) {
      features.size = {camera.camera.width, camera.camera.height};
      if (options.camera) features.lens = {*options.camera, "given"};
    } else if (camera.camera.width != image.cols || camera.camera.height != image.rows)
      throw InputError(
          input.path,
          fmt::format("the image has {}x{} px, but its camera in {} has {}x{} px", image.cols,
                      image.rows, path_, camera.camera.width, camera.camera.height));
    if (camera.camera.lens != geometry::Lens::kPinhole)
      throw InputError(path_, fmt::format("a camera has a {} lens, but reconstruction needs a "
                                          "pinhole camera: undistort the images first",
                                          geometry::name_of(camera.camera.lens)));
    if (!options.camera)
      features.lens = {camera.camera, camera.is_focal_known ? "database" : "guess"};
    features.features = std::move(known.features);
    if (image.empty())
      features.features.colors.assign(features.features.points.size(), cv::Vec3b::all(128));
    else
      add_colors(image, features.features);
    // Without files, only the names distinguish images.
    features.key = cache_key(fmt::format("{} database {} {}", features.key, sum_, input.name));
    index_of_image_[found->second] = static_cast<int>(index_of_image_.size());
  }

  // The pairs of the images for which fill() was called, in their order.
  [[nodiscard]] std::vector<Pair> pairs() {
    std::vector<Pair> result;
    for (auto& known : database_.pairs) {
      const auto first = index_of_image_.find(known.first);
      const auto second = index_of_image_.find(known.second);
      if (first == index_of_image_.end() || second == index_of_image_.end()) continue;
      Pair pair;
      pair.first = first->second;
      pair.second = second->second;
      pair.matches = static_cast<int>(known.matches.size());
      if (pair.first > pair.second) {
        std::swap(pair.first, pair.second);
        for (Match& match : known.matches) std::swap(match.first, match.second);
      }
      pair.view.inliers = std::move(known.matches);  // until verification
      result.push_back(std::move(pair));
    }
    std::sort(result.begin(), result.end(), [](const Pair& a, const Pair& b) {
      return std::pair(a.first, a.second) < std::pair(b.first, b.second);
    });
    return result;
  }

 private:
  static void add_colors(const cv::Mat& image, Features& features) {
    features.colors.clear();
    for (const cv::Point2f& p : features.points) {
      const int x = std::clamp(cvRound(p.x), 0, image.cols - 1);
      const int y = std::clamp(cvRound(p.y), 0, image.rows - 1);
      features.colors.push_back(image.channels() == 3
                                    ? image.at<cv::Vec3b>(y, x)
                                    : cv::Vec3b::all(image.at<std::uint8_t>(y, x)));
    }
  }

  ColmapDatabase database_;
  std::string sum_;
  std::string path_;
  std::map<std::string, int> index_;
  std::map<int, int> index_of_image_;  // maps an image of the database to its index here
};

// Features of all readable images, one image after the other: each uses all threads.
std::vector<ImageFeatures> find_all_features(const std::vector<Input>& inputs,
                                             const PipelineOptions& options, const Cache& cache,
                                             const std::optional<StartModel>& start,
                                             MappedStore& store, Progress& progress,
                                             const std::stop_token& stop, PipelineResult& result) {
  std::vector<ImageFeatures> images;
  FlowTracker tracker{FlowOptions{}};
  const std::string flow_name = options.flow ? flow_key(inputs, stop) : "";
  std::optional<FlowResult> tracks;
  if (options.flow) tracks = cache.flow(flow_name);
  const bool is_known = tracks.has_value();
  std::optional<KnownFeatures> known;
  if (!options.database.empty()) known.emplace(options.database);
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    throw_if_stopped(stop);
    ImageReport& report = result.images[i];
    ImageFeatures image_features;
    image_features.input = static_cast<int>(i);
    if (options.only_start && !start->has(inputs[i].name)) {
      report.outcome.reason = "the image is not in the start model";
      progress.advance();
      continue;
    }
    try {
      TARSIER_REQUIRE(known || !inputs[i].path.empty(), "image '{}' has no file", inputs[i].name);
      const cv::Mat image =
          inputs[i].path.empty() ? cv::Mat() : read_input_image(inputs[i], options, image_features);
      if (known) {
        known->fill(inputs[i], image, image_features, options);
        ++result.from_cache;
      } else if (options.flow) {
        // All images of a sequence have the same size.
        if (!images.empty() && image.size() != images.front().size)
          throw InputError(
              inputs[i].path,
              fmt::format(
                  "the image has {}x{} px, but the first image of the sequence has {}x{} px",
                  image.cols, image.rows, images.front().size.width, images.front().size.height));
        if (image.cols < 64 || image.rows < 64)
          throw InputError(inputs[i].path,
                           "the image is too small for optical flow: 64x64 px or more are needed");
        if (!is_known) tracker.add(image);
        image_features.key = cache_key(fmt::format("{} {}", flow_name, images.size()));
      } else if (find_image_features(image, options, cache, image_features)) {
        ++result.from_cache;
      }
      if (start) start->check_size(inputs[i], image_features.size);
      image_features.features.descriptors = store.add(image_features.features.descriptors);
      report.read = true;
      report.features = static_cast<int>(image_features.features.points.size());
      images.push_back(std::move(image_features));
    } catch (const InputError& error) {
      report.outcome.reason = error.what();
      log_warning("{} (left out)", error.what());
    }
    progress.advance();
  }
  if (known) result.pairs = known->pairs();
  if (options.flow) {
    if (!is_known) {
      tracks = tracker.finish();
      if (!images.empty()) cache.store(flow_name, *tracks);
    } else {
      result.from_cache += static_cast<int>(images.size());
    }
    for (std::size_t k = 0; k < images.size() && k < tracks->features.size(); ++k) {
      images[k].features = std::move(tracks->features[k]);
      result.images[at(images[k].input)].features =
          static_cast<int>(images[k].features.points.size());
    }
    for (FlowMatches& pair : tracks->pairs) {
      if (at(std::max(pair.first, pair.second)) >= images.size()) continue;
      Pair made;
      made.first = pair.first;
      made.second = pair.second;
      made.matches = static_cast<int>(pair.matches.size());
      made.view.inliers = std::move(pair.matches);  // until verification
      result.pairs.push_back(std::move(made));
    }
  }
  return images;
}

// Loads the results of another program (PipelineHooks::matched).
std::vector<ImageFeatures> load_all(const PipelineHooks& hooks, MappedStore& store,
                                    PipelineResult& result) {
  MatchedImages matched;
  hooks.matched(matched);
  for (ImageFeatures& image : matched.images) {
    image.features.descriptors = store.add(image.features.descriptors);
    ImageReport& report = result.images[at(image.input)];
    report.read = true;
    report.features = static_cast<int>(image.features.points.size());
  }
  for (auto& [input, reason] : matched.left_out)
    result.images[at(input)].outcome.reason = std::move(reason);
  result.pairs = std::move(matched.pairs);
  for (Pair& pair : result.pairs) pair.view.inliers = store.add(pair.view.inliers);
  return std::move(matched.images);
}

// Compares the images of all pairs of `result`. The pairs of an image are cached as soon as all of
// them are done. `has_matches`: the pairs have matches already, which are verified.
void compare_all(const std::vector<Input>& inputs, const std::vector<ImageFeatures>& images,
                 bool has_matches, const PipelineOptions& options, const Cache& cache,
                 const PipelineHooks& hooks, MappedStore& store, Progress& progress,
                 const std::stop_token& stop, PipelineResult& result) {
  std::mutex on_pair_mutex;
  std::atomic<int> from_cache{0};
  for (std::size_t start = 0; start < result.pairs.size();) {
    std::size_t end = start;
    while (end < result.pairs.size() && result.pairs[end].first == result.pairs[start].first) ++end;
    const int first = result.pairs[start].first;
    const bool use_cache = !hooks.on_pair;
    const std::string key = pairs_key(images[at(first)], options);
    Cache::Pairs cached_pairs = use_cache ? cache.pairs(key) : Cache::Pairs{};
    std::atomic<bool> fresh{false};
    const auto work = [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k) {
        if (stop.stop_requested()) return;
        Pair& pair = result.pairs[start + at(k)];
        if (const auto entry = cached_pairs.find(partner_key(images[at(pair.second)]));
            entry != cached_pairs.end()) {
          pair.matches = entry->second.matches;
          pair.view = entry->second.view;  // replaces tracked matches, if any
          ++from_cache;
        } else {
          const ImageFeatures& a = images[at(pair.first)];
          const ImageFeatures& b = images[at(pair.second)];
          std::vector<Match> matches;
          if (has_matches) {
            matches = pair.view.inliers.copy();
            pair.matches = static_cast<int>(matches.size());
            pair.view = verify_image_pair(a, b, matches, options);
          } else {
            compare_images(a, b, options, pair, &matches);
          }
          fresh = true;
          if (hooks.on_pair) {
            const std::lock_guard lock(on_pair_mutex);
            hooks.on_pair({inputs[at(a.input)], inputs[at(b.input)], a.features.points,
                           b.features.points, matches, pair.view});
          }
        }
        progress.advance();
      }
    };
    cv::parallel_for_(cv::Range(0, static_cast<int>(end - start)), work);
    throw_if_stopped(stop);
    store.trim();
    if (fresh && use_cache) {
      for (std::size_t k = start; k < end; ++k) {
        const Pair& pair = result.pairs[k];
        cached_pairs[partner_key(images[at(pair.second)])] = {pair.matches, pair.view};
      }
      cache.store(key, cached_pairs);
    }
    for (std::size_t k = start; k < end; ++k) {
      MatchList& inliers = result.pairs[k].view.inliers;
      inliers = store.add(inliers);
    }
    start = end;
  }
  result.from_cache += from_cache;
}

// Reads the files again, for the mapper. Files that can no longer be read or have changed are left
// out.
GrayImages gray_images(const std::vector<Input>& inputs, const std::vector<ImageFeatures>& images) {
  return [&inputs, &images](int image) {
    const ImageFeatures& features = images[at(image)];
    const std::string& path = inputs[at(features.input)].path;
    if (path.empty()) return cv::Mat();
    cv::Mat gray;
    try {
      gray = gray_of(read_sensor_image(path));
    } catch (const InputError&) {
      return cv::Mat();
    }
    return gray.size() == features.size ? gray : cv::Mat();
  };
}

// Key of all inputs of the mapper.
std::string mapper_key(const std::vector<ImageFeatures>& images,
                       const std::vector<std::string>& names, const ImageSet& image_set,
                       const std::vector<Pair>& pairs, const std::optional<StartPoses>& start,
                       const PipelineOptions& options) {
  const MapperOptions& m = options.mapper;
  Sha256 sum;
  sum.add(fmt::format("mapper-16 {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {}",
                      static_cast<int>(m.choice), m.auto_global, m.reprojection_px, m.min_angle_deg,
                      m.first_angle_deg, m.first_inliers, m.pose_inliers, m.pose_inlier_share,
                      m.pose_px, m.min_views, m.min_images, m.extend_px, m.extend_similarity,
                      m.refine_focal, m.refine_center, m.refine_distortion, m.seed, options.flow,
                      static_cast<int>(options.features.kind), options.shared_camera));
  for (std::size_t k = 0; k < images.size(); ++k) {
    sum.add(
        fmt::format("\n{} {} {}", partner_key(images[k]), image_set.images()[k].camera, names[k]));
  }
  for (const Pair& pair : pairs) {
    sum.add(fmt::format("\n{} {} {} {} {} {}", pair.first, pair.second, pair.matches,
                        pair.view.homography_inliers, pair.view.in_front, pair.view.median_angle));
    for (const double number : geometry::packed(pair.view.second_from_first))
      sum.add(fmt::format(" {}", number));
    sum.add(std::span(reinterpret_cast<const std::uint8_t*>(pair.view.inliers.data()),
                      pair.view.inliers.size() * sizeof(Match)));
  }
  if (start) {
    sum.add(fmt::format("\nstart {} {}", start->fixed, fmt::join(start->fixed_cameras, " ")));
    for (const auto& pose : start->poses) {
      sum.add("\n");
      if (!pose) continue;
      for (const double number : geometry::packed(*pose)) sum.add(fmt::format(" {}", number));
    }
  }
  return sum.hex().substr(0, 32);
}

// A model's world is initially the frame of one of its images. Where images are turned, that frame
// may lie on its side. This rotates the world so that down is y, as it is without turned images.
void turn_upright(Model& model) {
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  bool any = false;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    any = any || image.turns != 0;
    down += image.pose.rotation.transpose() * down_direction(image.turns);
  }
  if (!any || !(down.norm() > 1e-3)) return;
  geometry::Sim3 upright;
  upright.rotation =
      Eigen::Quaterniond::FromTwoVectors(down, Eigen::Vector3d::UnitY()).toRotationMatrix();
  transform(model, upright);
}

enum class Round {
  kFirst,
  kRemap,      // maps again with other lenses
  kReevaluate  // evaluates the earlier models with other lenses
};

// Returns the result of map(Round::kFirst), or a better one. Where the result is not one trusted
// model of all images and indicates other lenses than guessed, its models are evaluated with these
// lenses. Where the lenses differ much, mapping is repeated, and the better result is taken.
template <typename Map>
Reconstruction map_with_lenses(ImageSet& image_set, std::vector<Pair>& pairs, bool partial,
                               const std::stop_token& stop, const Map& map) {
  Reconstruction made = map(Round::kFirst);
  if (made.interrupted || made.models.empty()) return made;
  const bool is_whole =
      static_cast<std::size_t>(statistics_of(made.models[0]).registered) == made.outcomes.size();
  if (is_whole && made.trust[0] >= kGoodTrust) return made;
  const auto take = [&](double min_change, std::string_view why) {
    const std::vector<std::string> lines =
        image_set.adopt_focal_lengths(made.models, min_change, pairs, stop);
    for (const std::string& line : lines) made.log.push_back(fmt::format("{}: {}", line, why));
    return !lines.empty();
  };
  try {
    if (take(kMinRemapChange, "the images are mapped again with it")) {
      Reconstruction second = map(Round::kRemap);
      if (!second.interrupted) return better_of(std::move(made), std::move(second));
      made.interrupted = true;
    } else if (take(kMinReevaluateChange, "the pairs are evaluated again with it")) {
      Reconstruction reevaluated = map(Round::kReevaluate);
      if (reevaluated.interrupted) made.interrupted = true;
      if (reevaluated.interrupted || reevaluated.models.empty()) return made;
      reevaluated.log.insert(reevaluated.log.begin(), made.log.begin(), made.log.end());
      reevaluated.resumed = made.resumed;
      return reevaluated;
    }
  } catch (const Interrupted&) {
    if (!partial) throw;
    made.interrupted = true;
  }
  return made;
}

}  // namespace

void PipelineOptions::check() const {
  check_fields(*this);
  features.check();
  matching.check();
  two_view.check();
  mapper.check();
  TARSIER_REQUIRE(!features.wide || features.kind == FeatureKind::kSift,
                  "option 'wide' needs SIFT features");
  TARSIER_REQUIRE(
      !features.wide || (database.empty() && !flow),
      "option 'wide' needs feature detection: not possible with a database or optical flow");
  TARSIER_REQUIRE(memory_gb >= 0 && memory_gb <= 1024, "option 'memory_gb' is {}: expected 0..1024",
                  memory_gb);
  TARSIER_REQUIRE(database.empty() || !flow, "a database and optical flow exclude each other");
  TARSIER_REQUIRE(start_model.empty() || mapper.choice != MapperChoice::kGlobal,
                  "a start model is not possible with global mapping");
  TARSIER_REQUIRE(!start_model.empty() || !(fixed_poses || only_start),
                  "options 'fixed_poses' and 'only_start' need a start model");
  TARSIER_REQUIRE(pairs != PairChoice::kList || !pairs_file.empty(),
                  "no file with the image pairs");
  if (camera) {
    geometry::Camera sized = *camera;
    if (sized.width == 0) sized.width = sized.height = 1;
    sized.check();
  }
}

PipelineResult run_pipeline(const std::vector<Input>& inputs, const PipelineOptions& given,
                            Progress& progress, const std::stop_token& stop,
                            const PipelineHooks& hooks) {
  given.check();
  PipelineOptions options = seeded(given);
  PipelineResult result;
  for (const Input& input : inputs) {
    ImageReport report;
    report.name = input.name;
    report.path = input.path;
    result.images.push_back(std::move(report));
  }
  std::optional<StartModel> start;
  if (!options.start_model.empty()) start.emplace(options.start_model, inputs);
  const Cache cache(options.cache_folder);
  MappedStore store(options.cache_folder, static_cast<std::size_t>(options.memory_gb * 1e9));
  Stages stages(result, progress);

  std::vector<ImageFeatures> images;
  if (hooks.matched) {
    stages.start("load");
    images = load_all(hooks, store, result);
    stages.record();
  } else {
    stages.begin("features", static_cast<std::int64_t>(inputs.size()), "images");
    images = find_all_features(inputs, options, cache, start, store, progress, stop, result);
    stages.end();
  }
  const std::vector<char> is_of_start =
      start ? start->set_lenses(inputs, images) : std::vector<char>(images.size(), 0);

  ImageSet image_set(options);
  std::vector<std::string> names;
  KnownPositions positions;
  for (const ImageFeatures& image_features : images) {
    positions.push_back(inputs[at(image_features.input)].position);
    image_set.add(image_features, inputs[at(image_features.input)].name);
    names.push_back(inputs[at(image_features.input)].name);
    result.images[at(image_features.input)].focal_from =
        is_of_start[names.size() - 1] != 0 ? "start model" : image_features.lens.source;
  }
  options.mapper = image_set.mapper_options();
  std::optional<StartPoses> start_poses;
  if (start) {
    std::vector<int> cameras;
    for (const Image& image : image_set.images()) cameras.push_back(image.camera);
    const MapperOptions& requested = given.mapper;
    start_poses = start->poses(
        inputs, images, cameras, options.fixed_poses,
        requested.refine_focal || requested.refine_center || requested.refine_distortion);
  }

  if (!hooks.matched) {
    stages.begin("pairs", 1, "steps");
    const bool has_matches = options.flow || !options.database.empty();
    if (!has_matches) {
      const auto descriptors = [&](int i) { return images[at(i)].features.descriptors; };
      for (const auto& [first, second] : choose_pairs(names, positions, descriptors, options)) {
        Pair pair;
        pair.first = first;
        pair.second = second;
        result.pairs.push_back(std::move(pair));
      }
    }
    store.trim();
    progress.advance();
    stages.end();
    stages.begin("match", static_cast<std::int64_t>(result.pairs.size()), "pairs");
    compare_all(inputs, images, has_matches, options, cache, hooks, store, progress, stop, result);
    stages.end();
  }
  result.compared = static_cast<int>(result.pairs.size());
  result.verified =
      static_cast<int>(std::count_if(result.pairs.begin(), result.pairs.end(),
                                     [](const Pair& pair) { return !pair.view.inliers.empty(); }));

  if (hooks.on_matched) hooks.on_matched(images, inputs, result.pairs);
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<cv::Mat> descriptors;
  for (ImageFeatures& image_features : images) {
    colors.push_back(std::move(image_features.features.colors));
    if (!options.flow) descriptors.push_back(image_features.features.descriptors);
  }
  // A database may lack descriptors of some images: then tracks are not extended.
  if (std::any_of(images.begin(), images.end(), [](const ImageFeatures& image) {
        return static_cast<std::size_t>(image.features.descriptors.rows) <
               image.features.points.size();
      })) {
    descriptors.clear();
  }
  // image_set has copies.
  for (ImageFeatures& image_features : images) {
    image_features.features.points = {};
    image_features.features.sizes = {};
  }
  const MapperInput mapper_input{.cameras = image_set.cameras(),
                                 .images = image_set.images(),
                                 .colors = colors,
                                 .descriptors = descriptors,
                                 .release_memory = [&store] { store.trim(); },
                                 .kind = options.features.kind,
                                 .pairs = result.pairs,
                                 .tracked = options.flow,
                                 .gray = gray_images(inputs, images),
                                 .start = start_poses};
  stages.start("reconstruct");
  const std::vector<std::string> log = image_set.estimate_focal_lengths(result.pairs, stop);
  const std::string key =
      options.cache_folder.empty()
          ? ""
          : mapper_key(images, names, image_set, result.pairs, start_poses, options);
  std::optional<MapperState> last;  // state with the guessed lenses
  // Hooks with checkpoints of this name; "": without.
  const auto hooks_with = [&](const std::string& checkpoint) {
    MapperHooks mapping;
    mapping.watch = hooks.watch;
    mapping.show = hooks.show;
    mapping.partial = hooks.partial;
    mapping.save_interval_s = options.checkpoint_s;
    if (checkpoint.empty()) return mapping;
    if (!hooks.watch) mapping.resume_from = cache.checkpoint(checkpoint);
    mapping.save_checkpoint = [&cache, checkpoint,
                               warned = false](const MapperState& state) mutable {
      // A full disk must not stop the mapping.
      try {
        cache.store(checkpoint, state);
      } catch (const OutputError& error) {
        if (!warned) log_warning("cannot write a checkpoint: {}", error.what());
        warned = true;
      }
    };
    return mapping;
  };
  const auto map = [&](Round round) {
    const bool reevaluates = round == Round::kReevaluate;
    std::string checkpoint = key;
    if (!key.empty() && round != Round::kFirst)
      checkpoint += reevaluates ? Cache::kReevaluatedSuffix : Cache::kRemappedSuffix;
    MapperHooks mapping = hooks_with(checkpoint);
    mapping.save_checkpoint = [&, reevaluates,
                               store = mapping.save_checkpoint](const MapperState& state) {
      if (image_set.has_guess() && !reevaluates) {
        last = state;
        last->patch_rejections.clear();
        last->attempts.clear();  // with the previous lenses
      }
      if (store) store(state);
    };
    if (!reevaluates) return reconstruct(mapper_input, options.mapper, progress, stop, mapping);
    const auto known = static_cast<std::ptrdiff_t>(last->log.size());
    if (!mapping.resume_from || !mapping.resume_from->done)
      mapping.resume_from = std::exchange(last, std::nullopt);
    mapping.watch = {};
    Reconstruction reevaluated = reconstruct(mapper_input, options.mapper, progress, stop, mapping);
    reevaluated.log.erase(reevaluated.log.begin(), reevaluated.log.begin() + known);
    return reevaluated;
  };
  if (hooks.map) {
    const bool has_checkpoints = !key.empty() && !hooks.map_key.empty();
    result.reconstruction = hooks.map(
        mapper_input, options.mapper,
        hooks_with(has_checkpoints ? cache_key(fmt::format("{} {}", key, hooks.map_key)) : ""));
  } else {
    result.reconstruction = map_with_lenses(image_set, result.pairs, hooks.partial, stop, map);
  }
  result.reconstruction.log.insert(result.reconstruction.log.begin(), log.begin(), log.end());
  for (Model& model : result.reconstruction.models) turn_upright(model);
  // Skipped after an interruption, when the user waits for the result, and for given poses, which
  // the observations do not determine.
  if (!result.reconstruction.interrupted && !options.fixed_poses)
    add_uncertainty(options.mapper, result.reconstruction);
  stages.record();
  result.resumed = result.reconstruction.resumed;
  if (start) {
    StartSummary summary = start->summary();
    summary.registered = result.reconstruction.start_images;
    summary.fixed_poses = options.fixed_poses;
    result.start = std::make_shared<const StartSummary>(std::move(summary));
  }
  for (std::size_t k = 0; k < images.size(); ++k) {
    ImageReport& report = result.images[at(images[k].input)];
    report.outcome = result.reconstruction.outcomes[k];
    if (image_set.is_estimated(static_cast<int>(k))) report.focal_from = "pairs";
  }
  return result;
}

}  // namespace tarsier::sfm
