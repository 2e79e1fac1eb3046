// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/dense_run.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/dense/dense_state.h"
#include "tarsier/sfm/dense/gray_images.h"
#include "tarsier/sfm/dense/plane_field.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/scene/sensor_image.h"
#include "tarsier/sfm/scene/undistort.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr double kSparseTolerance = 0.003;  // share of the depth
constexpr int kMaxLargeRatio = 2;           // max size ratio of the images for small patches
constexpr double kMinMapSide = 16;          // px, of the shorter side of a map
constexpr double kVersion = 2;  // changes where maps depend on something other than options

double cpu_seconds() {
  timespec now{};
  if (clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) != 0) return 0;
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) * 1e-9;
}

void add_fields(Digest& digest, const OptionFields& fields) {
  for (const OptionField& field : fields) {
    digest.add(field.name);
    std::visit(
        [&](auto* value) {
          using T = std::remove_pointer_t<decltype(value)>;
          if constexpr (std::is_arithmetic_v<T>) digest.add(static_cast<double>(*value));
        },
        field.value);
  }
}

void add_view(Digest& digest, const geometry::Camera& camera, const geometry::Rigid3& pose) {
  for (const double number : {static_cast<double>(camera.width), static_cast<double>(camera.height),
                              camera.fx, camera.fy, camera.cx, camera.cy})
    digest.add(number);
  for (const double k : camera.distortion) digest.add(k);
  for (const double number : geometry::packed(pose)) digest.add(number);
}

void check_dense_input(const Model& model) {
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    image.pose.check();
    TARSIER_REQUIRE(
        image.camera >= 0 && static_cast<std::size_t>(image.camera) < model.cameras.size(),
        "camera {} of '{}'", image.camera, image.name);
    model.cameras[static_cast<std::size_t>(image.camera)].check();
  }
  for (std::size_t p = 0; p < model.points.size(); ++p)
    TARSIER_REQUIRE(model.points[p].position.allFinite(), "point {} of the model is not finite", p);
}

class DenseRun {
 public:
  DenseRun(const DenseOptions& options, const DenseJob& job, Progress& progress,
           const std::stop_token& stop, DebugSink* debug)
      : options_(options),
        job_(job),
        progress_(progress),
        stop_(stop),
        debug_(watched(debug)),
        cpu_start_(cpu_seconds()),
        memory_(static_cast<std::int64_t>(options.memory_gb * 1e9)) {}

  DenseResult run() {
    undistort();
    workspace_ = Workspace::open(job_.folder);
    choose();
    match();
    refine_and_filter();
    return finish();
  }

 private:
  [[nodiscard]] const ViewChoice& choice(int i) const {
    return choices_[static_cast<std::size_t>(i)];
  }
  DenseImage& image(int i) { return result_.images[static_cast<std::size_t>(i)]; }
  [[nodiscard]] std::string path(std::string_view file) const {
    return (fs::path(job_.folder) / file).string();
  }
  [[nodiscard]] std::string state_path(int i, MapKind kind) const {
    return (fs::path(job_.folder) / "stereo" / "state" /
            fmt::format("{}.{}.json", workspace_.name(i), name_of(kind)))
        .string();
  }

  // Writes the workspace's images and model, unless they exist already for the same images.
  void undistort() {
    TARSIER_REQUIRE(!job_.folder.empty() && job_.path_of != nullptr,
                    "the job has no folder or no images");
    const Model& model = job_.model;
    check_dense_input(model);
    check_coordinates(model);
    const auto registered = std::count_if(model.images.begin(), model.images.end(),
                                          [](const Image& one) { return one.registered; });
    if (registered < 2) {
      throw Error(ErrorKind::kInput,
                  fmt::format("the model has {} registered image{}: depth maps need two or more",
                              registered, registered == 1 ? "" : "s"));
    }
    Digest digest;
    digest.add(kVersion);
    digest.add(static_cast<double>(model.points.size()));
    bool images_exist = true;
    progress_.begin("read", registered, "images");
    for (const Image& one : model.images) {
      if (!one.registered) continue;
      throw_if_stopped(stop_);
      digest.add(one.name);
      digest.add(sha256_of_file(job_.path_of(one.name)));
      add_view(digest, model.cameras[static_cast<std::size_t>(one.camera)], one.pose);
      std::error_code ignored;
      images_exist =
          images_exist && fs::is_regular_file(fs::path(job_.folder) / "images" / one.name, ignored);
      progress_.advance();
    }
    progress_.end();
    for (const Point& point : model.points)
      for (int k = 0; k < 3; ++k) digest.add(point.position[k]);
    source_digest_ = digest.hex();
    const std::string record = path("stereo/state/undistorted.json");
    if (images_exist && !read_state(record, source_digest_).is_null()) return;
    remove_state(record);
    export_undistorted(
        job_.folder, model,
        [&](const std::string& name) { return read_sensor_image(job_.path_of(name)); }, progress_,
        stop_);
    write_state(record, source_digest_, nlohmann::json::object());
  }

  void choose() {
    choices_ = select_views(workspace_.sparse(), options_.views, stop_);
    result_.images.resize(choices_.size());
    std::string reason;
    int with_sources = 0;
    for (int i = 0; i < workspace_.count(); ++i) {
      ViewChoice& its = choices_[static_cast<std::size_t>(i)];
      image(i).name = workspace_.name(i);
      if (options_.min_depth > 0) its.min_depth = options_.min_depth;
      if (options_.max_depth > 0) its.max_depth = options_.max_depth;
      if (!its.sources.empty() && !(its.min_depth < its.max_depth)) {
        its.reason = fmt::format("its depths are from {} to {}, outside the given limits",
                                 its.min_depth, its.max_depth);
        its.sources.clear();
      }
      image(i).reason = its.reason;
      for (const ViewChoice::Source& source : its.sources)
        image(i).sources.push_back(workspace_.name(source.image));
      if (its.sources.empty())
        reason = fmt::format("{}: {}", printable(workspace_.name(i)), its.reason);
      else
        ++with_sources;
    }
    if (with_sources == 0) {
      throw Error(ErrorKind::kInput, "no image has source images for a depth map: " + reason);
    }
    for (int i = 0; i < workspace_.count(); ++i) {
      if (choice(i).sources.empty())
        log_warning("{}: left out: {}", workspace_.name(i), choice(i).reason);
      sizes_.push_back(size_of(i));
    }
    write_configs();
  }

  // The working size of an image.
  [[nodiscard]] cv::Size size_of(int i) const {
    const geometry::Camera& camera = workspace_.camera(i);
    const double side = std::max(camera.width, camera.height);
    const double min_scale = std::min(1.0, options_.min_side / side);
    double scale = std::max(1 / options_.reduce, min_scale);
    const double pixels = static_cast<double>(camera.width) * camera.height;
    const double memory_scale = max_scale_for_memory(pixels);
    if (memory_scale < scale) {
      log_warning(
          "{}: the image is reduced by a factor of {:.2f} instead of {:.2f}, to stay below {} GB "
          "of memory",
          workspace_.name(i), 1 / memory_scale, 1 / scale, options_.memory_gb);
      scale = memory_scale;
    }
    // Both sides are reduced alike, also where the shorter one reaches the minimum.
    scale = std::max(scale, std::min(1.0, kMinMapSide / std::min(camera.width, camera.height)));
    return {static_cast<int>(std::lround(camera.width * scale)),
            static_cast<int>(std::lround(camera.height * scale))};
  }

  // The factor by which an image of `pixels` px must be reduced for the memory limit. Its larger
  // image is kMaxLargeRatio times as large, but at most the original.
  [[nodiscard]] double max_scale_for_memory(double pixels) const {
    const int views = options_.views.views;
    const double bytes = 0.7 * static_cast<double>(memory_) / pixels;
    const auto map_bytes_per_px = static_cast<double>(matching_bytes(1, 0, views));
    const auto large_bytes_per_px = static_cast<double>(matching_bytes(0, 1, views));
    const double scale = std::sqrt(
        bytes / (map_bytes_per_px + kMaxLargeRatio * kMaxLargeRatio * large_bytes_per_px));
    if (kMaxLargeRatio * scale <= 1) return scale;
    return std::sqrt(std::max(bytes - large_bytes_per_px, 0.0) / map_bytes_per_px);
  }

  void write_configs() const {
    std::string matching;
    std::string fusion;
    for (int i = 0; i < workspace_.count(); ++i) {
      const ViewChoice& its = choice(i);
      if (its.sources.empty()) continue;
      matching += workspace_.name(i) + "\n";
      for (std::size_t s = 0; s < its.sources.size(); ++s)
        matching += (s > 0 ? ", " : "") + workspace_.name(its.sources[s].image);
      matching += "\n";
      fusion += workspace_.name(i) + "\n";
    }
    make_folder(path("stereo"));
    write_file_atomically(path("stereo/patch-match.cfg"), matching);
    write_file_atomically(path("stereo/fusion.cfg"), fusion);
  }

  MatchImage view(int i) {
    MatchImage result;
    result.gray = grays_->get(i);
    if (large_sizes_[static_cast<std::size_t>(i)] != result.gray.size())
      result.large = large_->get(i);
    result.camera = camera_of_map(workspace_.camera(i), result.gray.size());
    result.pose = workspace_.pose(i);
    return result;
  }

  MatchProblem problem_of(int i) {
    const ViewChoice& its = choice(i);
    MatchProblem problem;
    problem.reference = view(i);
    for (const ViewChoice::Source& source : its.sources)
      problem.sources.push_back(view(source.image));
    problem.min_depth = its.min_depth;
    problem.max_depth = its.max_depth;
    problem.seed = options_.seed * 1'000'003 + static_cast<std::uint64_t>(i);
    const geometry::Camera& camera = workspace_.camera(i);
    const double x = static_cast<double>(problem.reference.camera.width) / camera.width;
    const double y = static_cast<double>(problem.reference.camera.height) / camera.height;
    for (const KnownDepth& known : its.known) {
      problem.known.push_back(
          {{(known.pixel.x + 0.5) * x - 0.5, (known.pixel.y + 0.5) * y - 0.5}, known.depth});
    }
    return problem;
  }

  [[nodiscard]] std::string photometric_digest(int i) const {
    Digest digest;
    digest.add(kVersion);
    digest.add(source_digest_);
    digest.add(workspace_.name(i));
    const ViewChoice& its = choice(i);
    for (const double number : {its.min_depth, its.max_depth, static_cast<double>(options_.seed)})
      digest.add(number);
    const auto add_size = [&](int index) {
      const cv::Size size = sizes_[static_cast<std::size_t>(index)];
      digest.add(static_cast<double>(size.width));
      digest.add(static_cast<double>(size.height));
    };
    add_size(i);
    for (const ViewChoice::Source& source : its.sources) {
      digest.add(workspace_.name(source.image));
      add_size(source.image);
    }
    PatchMatchOptions matching = options_.matching;
    matching.geometric_rounds = 1;
    add_fields(digest, matching.fields());
    return digest.hex();
  }

  void match() {
    grays_.emplace(workspace_, sizes_, memory_ / 8);
    for (int i = 0; i < workspace_.count(); ++i) {
      const geometry::Camera& camera = workspace_.camera(i);
      const cv::Size size = sizes_[static_cast<std::size_t>(i)];
      large_sizes_.emplace_back(std::min(camera.width, kMaxLargeRatio * size.width),
                                std::min(camera.height, kMaxLargeRatio * size.height));
    }
    large_.emplace(workspace_, large_sizes_, memory_ / 8);
    progress_.begin("match", count_with_sources(), "images");
    for (int i = 0; i < workspace_.count(); ++i) {
      if (choice(i).sources.empty()) {
        digests_.emplace_back();
        continue;
      }
      throw_if_stopped(stop_);
      digests_.push_back(photometric_digest(i));
      const std::string record = state_path(i, MapKind::kPhotometric);
      const nlohmann::json before = read_state(record, digests_.back());
      if (!before.is_null() && workspace_.has_depth_map(i, MapKind::kPhotometric)) {
        image(i).cpu_seconds = before.value("cpu_seconds", 0.0);
        image(i).is_reused = true;
      } else {
        const double start = cpu_seconds();
        const PlaneMap map = match_planes(problem_of(i), options_.matching, stop_);
        remove_state(record);
        const DepthMap written{map.depth, map.normal, 1 - map.cost / kZeroConfidenceCost};
        workspace_.write_depth_map(i, written, MapKind::kPhotometric);
        image(i).cpu_seconds = cpu_seconds() - start;
        write_state(record, digests_.back(), {{"cpu_seconds", image(i).cpu_seconds}});
      }
      progress_.advance();
    }
    progress_.end();
  }

  // Geometric rounds with the depths of the sources, then the consistency filter.
  void refine_and_filter() {
    progress_.begin("compare", count_with_sources(), "images");
    for (int i = 0; i < workspace_.count(); ++i) {
      if (choice(i).sources.empty()) continue;
      throw_if_stopped(stop_);
      Digest digest;
      digest.add(digests_[static_cast<std::size_t>(i)]);
      for (const ViewChoice::Source& source : choice(i).sources)
        digest.add(digests_[static_cast<std::size_t>(source.image)]);
      add_fields(digest, PatchMatchOptions(options_.matching).fields());
      add_fields(digest, DepthFilterOptions(options_.filter).fields());
      const std::string record = state_path(i, MapKind::kGeometric);
      const std::string hex = digest.hex();
      const nlohmann::json before = debug_ == nullptr ? read_state(record, hex) : nlohmann::json();
      if (!before.is_null() && workspace_.has_depth_map(i)) {
        image(i).cpu_seconds += before.value("cpu_seconds", 0.0);
        image(i).known = before.value("known", 0.0);
        image(i).median_cost = before.value("median_cost", 0.0);
        image(i).sparse_known = before.value("sparse_known", 0.0);
        image(i).sparse_within = before.value("sparse_within", 0.0);
      } else {
        image(i).is_reused = false;
        const double start = cpu_seconds();
        compare(i);
        const double seconds = cpu_seconds() - start;
        write_state(record, hex,
                    {{"cpu_seconds", seconds},
                     {"known", image(i).known},
                     {"median_cost", image(i).median_cost},
                     {"sparse_known", image(i).sparse_known},
                     {"sparse_within", image(i).sparse_within}});
        image(i).cpu_seconds += seconds;
      }
      image(i).size = sizes_[static_cast<std::size_t>(i)];
      progress_.advance();
    }
    progress_.end();
    grays_.reset();
    large_.reset();
  }

  [[nodiscard]] PlaneMap photometric_map(int i) const {
    const DepthMap read = workspace_.read_depth_map(i, MapKind::kPhotometric);
    PlaneMap map;
    map.depth = read.depth;
    map.normal = read.normal;
    map.cost = (1 - read.confidence) * kZeroConfidenceCost;
    return map;
  }

  void compare(int i) {
    MatchProblem problem = problem_of(i);
    for (std::size_t s = 0; s < problem.sources.size(); ++s) {
      const int other = choice(i).sources[s].image;
      if (choice(other).sources.empty()) continue;
      problem.sources[s].depth =
          read_colmap_map(workspace_.path_of_map(other, "depth_maps", MapKind::kPhotometric), 1);
    }
    PlaneMap map = photometric_map(i);
    if (options_.matching.geometric_rounds > 0)
      map = refine_planes(problem, map, options_.matching, stop_);
    const DepthMap filtered_map = filtered(problem, map, options_.filter);
    remove_state(state_path(i, MapKind::kGeometric));
    workspace_.write_depth_map(i, filtered_map);
    std::vector<float> costs;
    for (int y = 0; y < filtered_map.depth.rows; ++y)
      for (int x = 0; x < filtered_map.depth.cols; ++x)
        if (filtered_map.depth.at<float>(y, x) > 0) costs.push_back(map.cost(y, x));
    image(i).known =
        static_cast<double>(costs.size()) / static_cast<double>(filtered_map.depth.total());
    image(i).median_cost = 0;
    if (!costs.empty()) {
      const auto median = costs.begin() + static_cast<std::ptrdiff_t>(costs.size() / 2);
      std::nth_element(costs.begin(), median, costs.end());
      image(i).median_cost = *median;
    }
    compare_with_points(problem, filtered_map, image(i));
    show(i, map, filtered_map);
  }

  // Compares the depths with the model's points.
  static void compare_with_points(const MatchProblem& problem, const DepthMap& filtered_map,
                                  DenseImage& image) {
    int seen = 0;
    int known = 0;
    int within = 0;
    for (const KnownDepth& point : problem.known) {
      const int x = static_cast<int>(std::lround(point.pixel.x));
      const int y = static_cast<int>(std::lround(point.pixel.y));
      if (x < 0 || y < 0 || x >= filtered_map.depth.cols || y >= filtered_map.depth.rows) continue;
      ++seen;
      const float depth = filtered_map.depth.at<float>(y, x);
      if (!(depth > 0)) continue;
      ++known;
      const Plane plane = plane_of(problem.reference.camera, x, y, 1 / depth,
                                   filtered_map.normal.at<cv::Vec3f>(y, x));
      const double inverse = plane.inverse_depth + plane.slope_x * (point.pixel.x - x) +
                             plane.slope_y * (point.pixel.y - y);
      if (std::abs(inverse * point.depth - 1) <= kSparseTolerance) ++within;
    }
    image.sparse_known = seen > 0 ? static_cast<double>(known) / seen : 0;
    image.sparse_within = known > 0 ? static_cast<double>(within) / known : 0;
  }

  void show(int i, const PlaneMap& map, const DepthMap& filtered_map) const {
    if (debug_ == nullptr) return;
    std::string name = workspace_.name(i);
    std::replace(name.begin(), name.end(), '/', '_');
    debug_->image(name + " depth", draw_depth(map.depth));
    debug_->image(name + " normal", draw_normals(map.normal));
    cv::Mat cost;
    map.cost.convertTo(cost, CV_8U, 255);
    debug_->image(name + " cost", cost);
    debug_->image(name + " kept", draw_depth(filtered_map.depth));
  }

  DenseResult finish() {
    std::vector<std::set<int>> sets(choices_.size());
    for (int i = 0; i < workspace_.count(); ++i) {
      for (const ViewChoice::Source& source : choice(i).sources) {
        sets[static_cast<std::size_t>(i)].insert(source.image);
        sets[static_cast<std::size_t>(source.image)].insert(i);
      }
    }
    std::vector<std::vector<int>> neighbours;
    for (std::size_t i = 0; i < sets.size(); ++i) {
      // Maps of images that are left out in this run are ignored, although an earlier run made
      // them.
      std::vector<int> around;
      for (const int j : sets[i])
        if (!choice(j).sources.empty()) around.push_back(j);
      if (choices_[i].sources.empty()) around.clear();
      neighbours.push_back(around);
    }
    result_.cloud = path("fused.ply");
    CloudWriter cloud(result_.cloud);
    const std::vector<std::int64_t> counts =
        fuse(workspace_, neighbours, options_.fusion, memory_ / 2, cloud, progress_, stop_);
    cloud.commit();
    result_.points = cloud.count();
    for (std::size_t i = 0; i < counts.size(); ++i) result_.images[i].points = counts[i];
    result_.cpu_seconds = cpu_seconds() - cpu_start_;
    // The names of files may not be UTF-8.
    const std::string text =
        to_json(result_).dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
    write_file_atomically(path("dense.json"), text + "\n");
    return result_;
  }

  [[nodiscard]] std::int64_t count_with_sources() const {
    return std::count_if(choices_.begin(), choices_.end(),
                         [](const ViewChoice& its) { return !its.sources.empty(); });
  }

  static constexpr float kZeroConfidenceCost = 3;  // above any cost

  const DenseOptions& options_;
  const DenseJob& job_;
  Progress& progress_;
  const std::stop_token& stop_;
  DebugSink* debug_;
  const double cpu_start_;
  const std::int64_t memory_;
  Workspace workspace_;
  std::string source_digest_;
  std::vector<ViewChoice> choices_;
  std::vector<cv::Size> sizes_;        // working sizes of the images
  std::vector<cv::Size> large_sizes_;  // sizes for small patches
  std::vector<std::string> digests_;
  std::optional<GrayImages> grays_;
  std::optional<GrayImages> large_;
  DenseResult result_;
};

}  // namespace

DenseResult run_dense(const DenseOptions& options, const DenseJob& job, Progress& progress,
                      const std::stop_token& stop, DebugSink* debug) {
  return DenseRun(options, job, progress, stop, debug).run();
}

}  // namespace tarsier::sfm
