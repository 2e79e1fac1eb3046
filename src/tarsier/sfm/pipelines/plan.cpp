// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/plan.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/features/pairs.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/pipelines/placement.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <variant>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using OrderedJson = nlohmann::ordered_json;

constexpr std::int64_t kMaxPlanBytes = 2'000'000'000;
constexpr std::int64_t kMaxPairsBytes = 1'000'000'000;
constexpr const char* kPlanWriter = "tarsier sfm plan";
constexpr int kPlanVersion = 2;

std::string plan_path(const std::string& folder) {
  return (fs::path(folder) / "plan.json").string();
}
// The path of a file relative to a folder. Both can then be moved together, and another machine may
// mount them elsewhere.
std::string path_from(const std::string& folder, const fs::path& file) {
  const fs::path parent = fs::absolute(file).parent_path();
  return (fs::proximate(parent, fs::weakly_canonical(folder)) / file.filename()).string();
}
std::string pairs_path(const std::string& folder) {
  return (fs::path(folder) / "pairs.txt").string();
}

// Option structs that have fields().
struct NamedFields {
  const char* name;
  OptionFields fields;
};
std::vector<NamedFields> parts_of(PipelineOptions& options) {
  return {{"features", options.features.fields()},
          {"matching", options.matching.fields()},
          {"two_view", options.two_view.fields()},
          {"mapper", options.mapper.fields()},
          {"pipeline", options.fields()}};
}

// Options that are not numbers in a range.
struct NamedSwitch {
  const char* name;
  bool& value;
};
std::vector<NamedSwitch> switches_of(PipelineOptions& options) {
  return {{"refine_focal", options.mapper.refine_focal},
          {"refine_center", options.mapper.refine_center},
          {"refine_distortion", options.mapper.refine_distortion},
          {"shared_camera", options.shared_camera},
          {"fixed_camera", options.fixed_camera}};
}

OrderedJson json_of(const geometry::Camera& c) {
  return {{"lens", geometry::name_of(c.lens)},
          {"width", c.width},
          {"height", c.height},
          {"fx", c.fx},
          {"fy", c.fy},
          {"cx", c.cx},
          {"cy", c.cy},
          {"distortion", c.distortion},
          {"rms", c.rms}};
}

OrderedJson json_of(PipelineOptions options) {
  OrderedJson json;
  for (const NamedFields& part : parts_of(options)) {
    for (const OptionField& field : part.fields) {
      std::visit(
          [&](auto* value) {
            using T = std::remove_pointer_t<decltype(value)>;
            if constexpr (std::is_arithmetic_v<T>)
              json[part.name][std::string(field.name)] = *value;
            else
              TARSIER_REQUIRE(false, "the option {} is not a number", field.name);
          },
          field.value);
    }
  }
  for (const NamedSwitch& entry : switches_of(options)) json["switches"][entry.name] = entry.value;
  json["feature_kind"] = static_cast<int>(options.features.kind);
  json["mapper_choice"] = static_cast<int>(options.mapper.choice);
  json["pairs"] = static_cast<int>(options.pairs);
  json["seed"] = options.seed;
  if (options.camera) json["camera"] = json_of(*options.camera);
  return json;
}

// The members of a JSON object. Each must exist and have the right type.
class Members {
 public:
  Members(const Json& json, const std::string& path) : json_(json), path_(path) {}

  [[noreturn]] void fail(std::string_view name) const {
    throw InputError(
        path_,
        fmt::format(
            "is not a plan of this program, or is damaged ('{}'): run `tarsier sfm plan` again",
            name));
  }
  [[nodiscard]] const Json& get(std::string_view name) const {
    if (!json_.is_object()) fail(name);
    const auto found = json_.find(name);
    if (found == json_.end()) fail(name);
    return *found;
  }
  [[nodiscard]] bool has(std::string_view name) const {
    return json_.is_object() && json_.contains(name);
  }
  [[nodiscard]] Members object(std::string_view name) const { return {get(name), path_}; }
  [[nodiscard]] std::string text(std::string_view name) const {
    const Json& value = get(name);
    if (!value.is_string()) fail(name);
    return value.get<std::string>();
  }
  template <class T>
  [[nodiscard]] T number(std::string_view name) const {
    const Json& value = get(name);
    if constexpr (std::is_same_v<T, bool>) {
      if (!value.is_boolean()) fail(name);
    } else if constexpr (std::is_integral_v<T>) {
      if (!value.is_number_integer()) fail(name);
      if (value.is_number_unsigned()) {
        if (value.get<std::uint64_t>() > static_cast<std::uint64_t>(std::numeric_limits<T>::max()))
          fail(name);
      } else if (std::is_unsigned_v<T> ||
                 value.get<std::int64_t>() <
                     static_cast<std::int64_t>(std::numeric_limits<T>::lowest())) {
        fail(name);
      }
    } else {
      if (!value.is_number()) fail(name);
    }
    return value.get<T>();
  }
  template <class T>
  [[nodiscard]] T choice(std::string_view name, T last) const {
    const int value = number<int>(name);
    if (value < 0 || value > static_cast<int>(last)) fail(name);
    return static_cast<T>(value);
  }

 private:
  const Json& json_;
  const std::string& path_;
};

geometry::Camera camera_of(const Members& json) {
  geometry::Camera c;
  const auto lens = geometry::lens_named(json.text("lens"));
  if (!lens) json.fail("lens");
  c.lens = *lens;
  c.width = json.number<int>("width");
  c.height = json.number<int>("height");
  c.fx = json.number<double>("fx");
  c.fy = json.number<double>("fy");
  c.cx = json.number<double>("cx");
  c.cy = json.number<double>("cy");
  c.rms = json.number<double>("rms");
  const Json& numbers = json.get("distortion");
  if (!numbers.is_array() || numbers.size() != c.distortion.size()) json.fail("distortion");
  for (std::size_t i = 0; i < c.distortion.size(); ++i) {
    if (!numbers[i].is_number()) json.fail("distortion");
    c.distortion[i] = numbers[i].get<double>();
  }
  return c;
}

Eigen::Vector3d position_of(const Members& image) {
  const Json& numbers = image.get("place");
  if (!numbers.is_array() || numbers.size() != 3) image.fail("place");
  Eigen::Vector3d position;
  for (int k = 0; k < 3; ++k) {
    const Json& number = numbers[static_cast<std::size_t>(k)];
    if (!number.is_number()) image.fail("place");
    position[k] = number.get<double>();
  }
  if (!position.allFinite()) image.fail("place");
  return position;
}

PipelineOptions options_of(const Members& json) {
  PipelineOptions options;
  for (const NamedFields& part : parts_of(options)) {
    const Members members = json.object(part.name);
    for (const OptionField& field : part.fields) {
      std::visit(
          [&](auto* value) {
            using T = std::remove_pointer_t<decltype(value)>;
            if constexpr (std::is_arithmetic_v<T>) *value = members.number<T>(field.name);
          },
          field.value);
    }
  }
  const Members switches = json.object("switches");
  for (const NamedSwitch& entry : switches_of(options))
    entry.value = switches.number<bool>(entry.name);
  options.features.kind = json.choice("feature_kind", FeatureKind::kAkaze);
  options.mapper.choice = json.choice("mapper_choice", MapperChoice::kAuto);
  options.pairs = json.choice("pairs", PairChoice::kList);
  options.seed = json.number<std::uint64_t>("seed");
  if (json.has("camera")) options.camera = camera_of(json.object("camera"));
  return options;
}

bool is_sum(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

int clusters_of(std::size_t images, int size) {
  return static_cast<int>((images + static_cast<std::size_t>(size) - 1) /
                          static_cast<std::size_t>(size));
}

bool is_cluster_size(std::size_t images, int size) {
  return size == 0 || (size >= kMinClusterSize && clusters_of(images, size) <= kMaxShards);
}

void require_utf8(const std::string& text) {
  try {
    (void)Json(text).dump();
  } catch (const Json::exception&) {
    throw InputError(printable(text),
                     "the name is not valid UTF-8, which a plan needs: rename the file");
  }
}

}  // namespace

std::vector<Input> Plan::inputs() const {
  std::vector<Input> inputs;
  inputs.reserve(images.size());
  for (const PlannedImage& image : images) inputs.push_back({image.name, image.path, image.place});
  return inputs;
}

int Plan::clusters() const {
  return cluster_size == 0 ? 0 : clusters_of(images.size(), cluster_size);
}

Plan write_plan(const std::string& folder, const std::vector<Input>& inputs,
                const PipelineOptions& given, int shards, Progress& progress,
                const std::stop_token& stop, int cluster_size, const Positions& known) {
  given.check();
  TARSIER_REQUIRE(shards >= 1 && shards <= kMaxShards, "shards {}: expected 1..{}", shards,
                  kMaxShards);
  TARSIER_REQUIRE(is_cluster_size(inputs.size(), cluster_size),
                  "clusters of {} of {} images: expected {} or more, and at most {} clusters",
                  cluster_size, inputs.size(), kMinClusterSize, kMaxShards);
  TARSIER_REQUIRE(given.database.empty(), "a database cannot be divided into shards");
  TARSIER_REQUIRE(!given.flow, "matches by flow cannot be divided into shards");
  require_two_images(inputs, inputs.empty() ? "images" : inputs.front().path);
  require_names(inputs);
  make_folder(folder);
  Plan plan;
  plan.options = given;
  plan.options.cache_folder.clear();
  plan.options.memory_gb = 0;
  plan.options.checkpoint_s = PipelineOptions{}.checkpoint_s;
  plan.shards = shards;
  plan.cluster_size = cluster_size;
  if (given.pairs == PairChoice::kList) {
    std::vector<std::string> names;
    names.reserve(inputs.size());
    for (const Input& input : inputs) names.push_back(input.name);
    (void)read_pairs_list(given.pairs_file, names);
    const std::string list = read_file(given.pairs_file, kMaxPairsBytes);
    plan.options.pairs_file = pairs_path(folder);
    Sha256 sum;
    sum.add(list);
    plan.pairs = sum.hex();
    write_file_atomically(plan.options.pairs_file, list);
  }
  progress.begin("plan", static_cast<std::int64_t>(inputs.size()), "images");
  OrderedJson images = OrderedJson::array();
  for (const Input& input : with_camera_positions(inputs, known, given, stop)) {
    throw_if_stopped(stop);
    const std::string file = path_from(folder, input.path);
    PlannedImage image{input.name, (fs::path(folder) / file).string(), "", input.position};
    require_utf8(image.name);
    require_utf8(file);
    try {
      image.sha256 = sha256_of_file(image.path);
    } catch (const InputError& error) {
      log_warning("{} (will be left out)", error.what());
    }
    images.push_back({{"name", image.name}, {"file", file}, {"sha256", image.sha256}});
    if (image.place)
      images.back()["place"] = {(*image.place)[0], (*image.place)[1], (*image.place)[2]};
    plan.images.push_back(std::move(image));
    progress.advance();
  }
  progress.end();
  OrderedJson json{{"written_by", kPlanWriter},
                   {"version", kPlanVersion},
                   {"shards", shards},
                   {"options", json_of(plan.options)}};
  if (cluster_size > 0) json["cluster_size"] = cluster_size;
  if (!plan.pairs.empty()) json["pairs_sha256"] = plan.pairs;
  json["images"] = std::move(images);
  const std::string text = json.dump(1) + "\n";
  Sha256 sum;
  sum.add(text);
  plan.key = sum.hex();
  write_file_atomically(plan_path(folder), text);
  return plan;
}

Plan read_plan(const std::string& folder) {
  const std::string path = plan_path(folder);
  std::error_code ignored;
  if (!fs::exists(path, ignored))
    throw InputError(path, "there is no plan: make one with `tarsier sfm plan`");
  const std::string text = read_file(path, kMaxPlanBytes);
  const Json json =
      parse_json(text, path, {.max_bytes = kMaxPlanBytes, .max_values = kMaxPlanBytes});
  const Members members(json, path);
  if (members.text("written_by") != kPlanWriter) members.fail("written_by");
  if (const auto version = members.number<int>("version"); version != kPlanVersion) {
    throw InputError(path, fmt::format("the plan has version {}, but this program reads version "
                                       "{}: run `tarsier sfm plan` again",
                                       version, kPlanVersion));
  }
  Plan plan;
  Sha256 sum;
  sum.add(text);
  plan.key = sum.hex();
  plan.shards = members.number<int>("shards");
  if (plan.shards < 1 || plan.shards > kMaxShards) members.fail("shards");
  if (members.has("cluster_size")) plan.cluster_size = members.number<int>("cluster_size");
  plan.options = options_of(members.object("options"));
  if (plan.options.pairs == PairChoice::kList) {
    plan.options.pairs_file = pairs_path(folder);
    plan.pairs = members.text("pairs_sha256");
    if (sha256_of_file(plan.options.pairs_file) != plan.pairs)
      throw InputError(plan.options.pairs_file,
                       "was changed after the plan was made: run `tarsier sfm plan` again");
  }
  try {
    plan.options.check();
    TARSIER_REQUIRE(!plan.options.camera || plan.options.camera->lens == geometry::Lens::kPinhole,
                    "the camera is not a pinhole camera");
  } catch (const std::invalid_argument& error) {
    throw InputError(
        path, fmt::format(
                  "is not a plan of this program, or is damaged ({}): run `tarsier sfm plan` again",
                  error.what()));
  }
  const Json& images = members.get("images");
  if (!images.is_array() || images.size() < 2) members.fail("images");
  std::set<std::string> names;
  for (const Json& entry : images) {
    const Members image(entry, path);
    PlannedImage& planned = plan.images.emplace_back(
        PlannedImage{image.text("name"), image.text("file"), image.text("sha256")});
    if (image.has("place")) planned.place = position_of(image);
    if (!image_name_error(planned.name).empty() || !names.insert(planned.name).second)
      members.fail("name");
    if (planned.path.empty() || planned.path.find('\0') != std::string::npos) members.fail("file");
    planned.path = (fs::path(folder) / planned.path).string();
    if (!planned.sha256.empty() && !is_sum(planned.sha256)) members.fail("sha256");
  }
  if (plan.cluster_size < 0 || !is_cluster_size(plan.images.size(), plan.cluster_size))
    members.fail("cluster_size");
  return plan;
}

}  // namespace tarsier::sfm
