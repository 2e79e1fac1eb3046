// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/checkpoint.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/mapper/packed_records.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kMaxCheckpointBytes = 16'000'000'000;
constexpr std::int32_t kVersion = 6;  // of the format, and of the mapping algorithm

void put(PackedWriter& writer, const std::vector<geometry::Camera>& cameras) {
  writer.put(static_cast<std::uint64_t>(cameras.size()));
  for (const geometry::Camera& camera : cameras) put(writer, camera);
}

std::vector<geometry::Camera> get_cameras(PackedReader& reader) {
  const auto count = reader.get<std::uint64_t>();
  std::vector<geometry::Camera> cameras;
  for (std::uint64_t k = 0; k < count; ++k)  // a wrong count ends with the file
    cameras.push_back(get_camera(reader));
  return cameras;
}

void put(PackedWriter& writer, const std::vector<std::string>& texts) {
  writer.put(static_cast<std::uint64_t>(texts.size()));
  for (const std::string& text : texts) writer.put(text);
}

void put(PackedWriter& writer, const std::vector<PatchRejection>& rejections) {
  writer.put(static_cast<std::uint64_t>(rejections.size()));
  for (const PatchRejection& rejection : rejections) {
    writer.put(rejection.reason);
    writer.put(static_cast<std::uint8_t>(rejection.patches_differ));
  }
}

std::vector<PatchRejection> get_patch_rejections(PackedReader& reader) {
  const auto count = reader.get<std::uint64_t>();
  std::vector<PatchRejection> rejections;
  for (std::uint64_t k = 0; k < count; ++k) {
    PatchRejection& rejection = rejections.emplace_back();
    rejection.reason = reader.get_text();
    rejection.patches_differ = reader.get<std::uint8_t>() != 0;
  }
  return rejections;
}

std::vector<std::string> get_texts(PackedReader& reader) {
  const auto count = reader.get<std::uint64_t>();
  std::vector<std::string> texts;
  for (std::uint64_t k = 0; k < count; ++k) texts.push_back(reader.get_text());
  return texts;
}

bool is_index(std::int64_t index, std::size_t size) {
  return index >= 0 && static_cast<std::size_t>(index) < size;
}

bool are_observations(const std::vector<Observation>& all, const std::vector<Image>& images) {
  return std::all_of(all.begin(), all.end(), [&](const Observation& seen) {
    return is_index(seen.image, images.size()) &&
           is_index(seen.feature, images[at(seen.image)].features.size());
  });
}

bool are_ascending(const std::vector<int>& indices, std::size_t size) {
  return std::all_of(indices.begin(), indices.end(), [&](int i) { return is_index(i, size); }) &&
         std::is_sorted(indices.begin(), indices.end(), std::less_equal<>());
}

void put(PackedWriter& writer, const GlobalStartState& state) {
  writer.put(std::array<std::int32_t, 3>{state.image, state.step, state.round});
  writer.put(state.edges);
  writer.put(state.nodes);
  writer.put(state.rotations);
  put(writer, state.model);
  writer.put(state.points);
  writer.put(state.rejections);
  put(writer, state.log);
}

GlobalStartState get_global_start(PackedReader& reader) {
  GlobalStartState state;
  const auto numbers = reader.get<std::array<std::int32_t, 3>>();
  state.image = numbers[0];
  state.step = numbers[1];
  state.round = numbers[2];
  state.edges = reader.get_all<int>();
  state.nodes = reader.get_all<int>();
  state.rotations = reader.get_all<Eigen::Matrix3d>();
  state.model = get_packed_model(reader);
  state.points = reader.get_all<Eigen::Vector3d>();
  state.rejections = reader.get_all<PairRejection>();
  state.log = get_texts(reader);
  return state;
}

void put(PackedWriter& writer, const ModelJoin& join) {
  writer.put(std::array<std::int32_t, 6>{join.first, join.second, join.images, join.agreeing,
                                         join.points, join.inliers});
  writer.put(join.rotation_deg);
  writer.put(join.scale_error);
  writer.put(join.first_from_second.scale);
  writer.put(join.first_from_second.rotation);
  writer.put(join.first_from_second.translation);
  writer.put(join.refusal);
}

ModelJoin get_join(PackedReader& reader) {
  ModelJoin join;
  const auto numbers = reader.get<std::array<std::int32_t, 6>>();
  join.first = numbers[0];
  join.second = numbers[1];
  join.images = numbers[2];
  join.agreeing = numbers[3];
  join.points = numbers[4];
  join.inliers = numbers[5];
  join.rotation_deg = reader.get<double>();
  join.scale_error = reader.get<double>();
  join.first_from_second.scale = reader.get<double>();
  join.first_from_second.rotation = reader.get<Eigen::Matrix3d>();
  join.first_from_second.translation = reader.get<Eigen::Vector3d>();
  join.refusal = reader.get_text();
  return join;
}

}  // namespace

void put(PackedWriter& writer, const PackedModel& model) {
  put(writer, model.cameras);
  writer.put(model.registered);
  for (const geometry::Rigid3& pose : model.poses) writer.put(geometry::packed(pose));
  writer.put(model.points);
  writer.put(model.point_indices);
  writer.put(model.positions);
  writer.put(model.colors);
  writer.put(model.errors);
  writer.put(model.track_lengths);
  writer.put(model.observations);
}

PackedModel get_packed_model(PackedReader& reader) {
  PackedModel model;
  model.cameras = get_cameras(reader);
  model.registered = reader.get_all<int>();
  for (std::size_t k = 0; k < model.registered.size(); ++k)
    model.poses.push_back(geometry::unpacked(reader.get<std::array<double, 12>>()));
  model.points = reader.get<std::int64_t>();
  model.point_indices = reader.get_all<int>();
  model.positions = reader.get_all<Eigen::Vector3d>();
  model.colors = reader.get_all<cv::Vec3b>();
  model.errors = reader.get_all<double>();
  model.track_lengths = reader.get_all<int>();
  model.observations = reader.get_all<Observation>();
  return model;
}

bool fits(const PackedModel& model, std::size_t cameras, const std::vector<Image>& images) {
  const std::size_t points = model.point_indices.size();
  return model.cameras.size() == cameras && model.poses.size() == model.registered.size() &&
         std::all_of(model.registered.begin(), model.registered.end(),
                     [&](int image) { return is_index(image, images.size()); }) &&
         model.points >= 0 && model.positions.size() == points && model.colors.size() == points &&
         model.errors.size() == points && model.track_lengths.size() == points &&
         std::all_of(
             model.point_indices.begin(), model.point_indices.end(),
             [&](int index) { return is_index(index, static_cast<std::size_t>(model.points)); }) &&
         std::all_of(model.track_lengths.begin(), model.track_lengths.end(),
                     [](int views) { return views > 0; }) &&
         std::accumulate(model.track_lengths.begin(), model.track_lengths.end(), std::int64_t{0}) ==
             static_cast<std::int64_t>(model.observations.size()) &&
         are_observations(model.observations, images);
}

PackedModel packed(const Model& model) {
  PackedModel result;
  result.cameras = model.cameras;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (!model.images[i].registered) continue;
    result.registered.push_back(static_cast<int>(i));
    result.poses.push_back(model.images[i].pose);
  }
  result.points = static_cast<std::int64_t>(model.points.size());
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    const Point& point = model.points[p];
    if (point.track.empty()) continue;
    result.point_indices.push_back(static_cast<int>(p));
    result.positions.push_back(point.position);
    result.colors.push_back(point.color);
    result.errors.push_back(point.error);
    result.track_lengths.push_back(static_cast<int>(point.track.size()));
    result.observations.insert(result.observations.end(), point.track.begin(), point.track.end());
  }
  return result;
}

void unpack(const PackedModel& packed, Model& model) {
  TARSIER_REQUIRE(model.points.size() == static_cast<std::size_t>(packed.points),
                  "{} points, expected {}", model.points.size(), packed.points);
  model.cameras = packed.cameras;
  for (std::size_t k = 0; k < packed.registered.size(); ++k) {
    Image& image = model.images[at(packed.registered[k])];
    image.registered = true;
    image.pose = packed.poses[k];
  }
  auto next = packed.observations.begin();
  for (std::size_t k = 0; k < packed.point_indices.size(); ++k) {
    Point& point = model.points[at(packed.point_indices[k])];
    point.position = packed.positions[k];
    point.color = packed.colors[k];
    point.error = packed.errors[k];
    point.track.assign(next, next + packed.track_lengths[k]);
    next += packed.track_lengths[k];
  }
}

Model unpacked(const PackedModel& packed, const std::vector<Image>& images) {
  Model model;
  model.images.resize(images.size());
  for (std::size_t i = 0; i < images.size(); ++i) {
    model.images[i].name = images[i].name;
    model.images[i].camera = images[i].camera;
  }
  for (const int image : packed.registered) {
    model.images[at(image)] = images[at(image)];
    model.images[at(image)].points.assign(images[at(image)].features.size(), -1);
  }
  model.points.resize(static_cast<std::size_t>(packed.points));
  unpack(packed, model);
  for (std::size_t p = 0; p < model.points.size(); ++p)
    for (const Observation& seen : model.points[p].track)
      model.images[at(seen.image)].points[at(seen.feature)] = static_cast<int>(p);
  return model;
}

int MapperState::registered() const {
  std::size_t count = current ? current->model.registered.size() : 0;
  for (const PackedModel& model : models) count += model.registered.size();
  return static_cast<int>(count);
}

bool fits(const GlobalStartState& state, std::size_t pairs, std::size_t cameras,
          const std::vector<Image>& images) {
  if (!are_ascending(state.edges, pairs) || state.rejections.size() != pairs || state.round < 0)
    return false;
  if (state.step == GlobalStartState::kRotations || state.step == GlobalStartState::kRefused)
    return true;
  if (!are_ascending(state.nodes, images.size()) || state.nodes.size() != state.rotations.size())
    return false;
  if (state.step == GlobalStartState::kPositions) return true;
  return state.step == GlobalStartState::kAdjustment && fits(state.model, cameras, images);
}

bool fits(const MapperState& state, const std::vector<geometry::Camera>& cameras,
          const std::vector<Image>& images, std::size_t pairs) {
  if (!state.patch_rejections.empty() && state.patch_rejections.size() != pairs) return false;
  if (state.start && !is_index(state.start->image, images.size())) return false;
  for (const MapperState& each : state.attempts)
    if (!each.attempts.empty() || !fits(each, cameras, images, pairs)) return false;
  if (state.reasons.size() != images.size() || state.rejections.size() != pairs) return false;
  if (state.has_open_loop_model && state.models.empty()) return false;
  if (state.grown < 0 || at(state.grown) > state.models.size()) return false;
  for (const PackedModel& model : state.models)
    if (!fits(model, cameras.size(), images)) return false;
  for (const auto& [image, points] : state.failed)
    if (!is_index(image, images.size()) || points < 0) return false;
  if (!state.current) return true;
  const IncrementalMapperState& current = *state.current;
  return !current.model.registered.empty() && fits(current.model, cameras.size(), images) &&
         current.ray_cameras.size() == cameras.size() &&
         (current.tracks.empty() ||
          static_cast<std::int64_t>(current.tracks.size()) == current.model.points) &&
         std::all_of(current.tracks.begin(), current.tracks.end(),
                     [&](const auto& track) { return are_observations(track, images); });
}

namespace {

void put(PackedWriter& writer, const MapperState& state) {
  writer.put(static_cast<std::uint64_t>(state.models.size()));
  for (const PackedModel& model : state.models) put(writer, model);
  put(writer, state.log);
  put(writer, state.reasons);
  writer.put(state.rejections);
  writer.put(static_cast<std::int32_t>(state.done));
  writer.put(state.no_model);
  writer.put(std::array<std::int32_t, 3>{state.conflict_rounds, state.loop_stays_open ? 1 : 0,
                                         state.global_failed ? 1 : 0});
  writer.put(static_cast<std::int32_t>(state.current.has_value()));
  if (state.current) {
    put(writer, state.current->model);
    put(writer, state.current->ray_cameras);
    writer.put(static_cast<std::uint64_t>(state.current->tracks.size()));
    for (const auto& track : state.current->tracks) writer.put(track);
  }
  writer.put(static_cast<std::uint64_t>(state.failed.size()));
  for (const auto& [image, points] : state.failed)
    writer.put(std::array<std::int32_t, 2>{image, points});
  writer.put(std::array<std::int32_t, 5>{state.adjusted_at, state.stage, state.round,
                                         state.has_open_loop_model ? 1 : 0,
                                         state.is_global ? 1 : 0});
  writer.put(static_cast<std::int32_t>(state.start.has_value()));
  if (state.start) put(writer, *state.start);
  put(writer, state.patch_rejections);
  writer.put(static_cast<std::uint64_t>(state.attempts.size()));
  for (const MapperState& each : state.attempts) put(writer, each);
  writer.put(static_cast<std::uint64_t>(state.joins.size()));
  for (const ModelJoin& join : state.joins) put(writer, join);
  writer.put(static_cast<std::int32_t>(state.grown));
}

MapperState get_state(PackedReader& reader, bool is_attempt) {
  MapperState state;
  const auto models = reader.get<std::uint64_t>();
  for (std::uint64_t k = 0; k < models; ++k) state.models.push_back(get_packed_model(reader));
  state.log = get_texts(reader);
  state.reasons = get_texts(reader);
  state.rejections = reader.get_all<PairRejection>();
  state.done = reader.get<std::int32_t>() != 0;
  state.no_model = reader.get_text();
  const auto rejected = reader.get<std::array<std::int32_t, 3>>();
  state.conflict_rounds = rejected[0];
  state.loop_stays_open = rejected[1] != 0;
  state.global_failed = rejected[2] != 0;
  if (reader.get<std::int32_t>() != 0) {
    IncrementalMapperState& current = state.current.emplace();
    current.model = get_packed_model(reader);
    current.ray_cameras = get_cameras(reader);
    const auto tracks = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < tracks; ++k)
      current.tracks.push_back(reader.get_all<Observation>());
  }
  const auto failed = reader.get<std::uint64_t>();
  for (std::uint64_t k = 0; k < failed; ++k) {
    const auto numbers = reader.get<std::array<std::int32_t, 2>>();
    state.failed.emplace_back(numbers[0], numbers[1]);
  }
  const auto numbers = reader.get<std::array<std::int32_t, 5>>();
  state.adjusted_at = numbers[0];
  state.stage = numbers[1];
  state.round = numbers[2];
  state.has_open_loop_model = numbers[3] != 0;
  state.is_global = numbers[4] != 0;
  if (reader.get<std::int32_t>() != 0) state.start = get_global_start(reader);
  state.patch_rejections = get_patch_rejections(reader);
  const auto attempts = reader.get<std::uint64_t>();
  if (is_attempt && attempts > 0) throw Damaged();
  for (std::uint64_t k = 0; k < attempts; ++k) state.attempts.push_back(get_state(reader, true));
  const auto joins = reader.get<std::uint64_t>();
  for (std::uint64_t k = 0; k < joins; ++k) state.joins.push_back(get_join(reader));
  state.grown = reader.get<std::int32_t>();
  return state;
}

}  // namespace

void write_checkpoint(const std::string& path, const MapperState& state) {
  PackedWriter writer;
  writer.put(kVersion);
  put(writer, state);
  writer.write(path);
}

std::optional<MapperState> read_checkpoint(const std::string& path) {
  try {
    PackedReader reader(path, kMaxCheckpointBytes);
    if (reader.get<std::int32_t>() != kVersion) return std::nullopt;
    return get_state(reader, false);
  } catch (const Damaged&) {
  } catch (const InputError&) {
  }
  return std::nullopt;
}

}  // namespace tarsier::sfm
