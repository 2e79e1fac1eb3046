// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/mapping.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/consistency/model_conflicts.h"
#include "tarsier/sfm/consistency/open_loops.h"
#include "tarsier/sfm/consistency/repeated_structure.h"
#include "tarsier/sfm/mapper/global_start.h"
#include "tarsier/sfm/mapper/growth.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/initial_pair.h"
#include "tarsier/sfm/mapper/interval_timer.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/model_parts.h"
#include "tarsier/sfm/mapper/outcomes.h"
#include "tarsier/sfm/mapper/remaining_images.h"
#include "tarsier/sfm/mapper/start_poses.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kMaxInitialPairs = 20;
constexpr int kMaxConflictRounds = 4;  // max times that images are mapped again without some pairs
const std::string kStartRefusal = "the start model is rejected: ";

int first_registered(const Model& model) {
  const auto first = std::find_if(model.images.begin(), model.images.end(),
                                  [](const Image& image) { return image.registered; });
  return static_cast<int>(first - model.images.begin());
}

class Mapping {
 public:
  Mapping(const MapperInput& input, const MapperOptions& options, Progress& progress,
          const std::stop_token& stop, const MapperHooks& hooks)
      : input_(input),
        options_(options),
        progress_(progress),
        stop_(stop),
        hooks_(hooks),
        remaining_(input) {
    result_.outcomes.resize(input_.images.size());
  }

  Reconstruction run() {
    progress_.begin("reconstruct", static_cast<std::int64_t>(input_.images.size()), "images");
    evidence_ = check_evidence(input_.cameras, input_.images, input_.pairs);
    if (input_.start) {
      std::vector<char> refused;
      refused.reserve(evidence_.size());
      for (const PairEvidence& evidence : evidence_)
        refused.push_back(evidence.is_refused() ? 1 : 0);
      start_ = check_start(*input_.start, input_, refused, options_.reprojection_px, stop_);
      result_.start_images = start_.accepted;
    }
    if (hooks_.resume_from && !hooks_.watch &&
        fits(*hooks_.resume_from, input_.cameras, input_.images, input_.pairs.size())) {
      resume(*hooks_.resume_from);
    } else {
      for (std::size_t k = 0; k < input_.pairs.size(); ++k)
        if (evidence_[k].is_refused()) remaining_.reject(k, PairRejection::kMissingFeatures);
    }
    try {
      while (!done_) {
        if (!mapper_ && !begin_model()) break;
        grow();
      }
      done_ = true;
      save_checkpoint();
    } catch (const Interrupted&) {
      if (!growth_.between_states) save_checkpoint();
      if (!hooks_.partial) throw;
      result_.interrupted = true;
      if (open_loop_model_) {
        result_.models.push_back(std::move(*open_loop_model_));
      } else if (mapper_) {
        result_.models.push_back(mapper_->finished(input_.colors));
      } else if (conflicting_model_) {
        result_.models.push_back(std::move(*conflicting_model_));
      } else if (std::optional<Model> rough = rough_model()) {
        result_.models.push_back(std::move(*rough));
      }
      if (result_.models.empty()) throw;
    }
    progress_.end();
    conflicts_.resize(result_.models.size());
    add_outcomes(input_, options_, evidence_, remaining_.rejections(), is_repetitive(), conflicts_,
                 result_);
    if (result_.interrupted && result_.models.empty()) throw Interrupted();
    return std::move(result_);
  }

  // Whether the scene has repeated structure: a model was rejected because of conflicts, or global
  // mapping could not close its loops.
  [[nodiscard]] bool is_repetitive() const {
    return input_.is_repetitive || conflict_rounds_ > 0 || loop_stays_open_;
  }

 private:
  // --- one model ---

  // Images of a start model are connected by their poses.
  [[nodiscard]] Components components() const { return remaining_.components(start_.fits); }

  // Creates a mapper with the features of one component only: all images that can be registered are
  // in it, and a folder of many small scenes does not hold all features for each.
  void make_mapper(Components& components, int root) {
    mapper_.reset();
    Model model = remaining_.model_of(components, root);
    std::vector<std::vector<Observation>> tracks =
        make_tracks(remaining_.pairs_of(components, root), feature_counts(model));
    mapper_.emplace(std::move(model), std::move(tracks), input_.descriptors, input_.kind, options_);
    if (input_.start) fix_start_poses();
    if (hooks_.watch) {
      mapper_->watch([&](const char* stage, const IncrementalMapper& now) {
        if (stage == std::string_view("before")) ++adjustments_;
        hooks_.watch(fmt::format("grown-{:03}-{}", adjustments_, stage),
                     now.finished(input_.colors, 2));
      });
    }
  }

  // Maps a component of the remaining images globally, if one is large enough and is not refused.
  // `only`: the root of the component to try, of whatever size; -1: all.
  bool begin_globally(Components& components, int only) {
    std::map<int, std::vector<std::size_t>> pairs_of = remaining_.pairs_by_component(components);
    std::map<int, int> sizes;
    for (std::size_t i = 0; i < input_.images.size(); ++i)
      ++sizes[components.root(static_cast<int>(i))];
    std::vector<std::pair<int, int>> order;
    order.reserve(pairs_of.size());
    for (const auto& [root, all] : pairs_of) order.emplace_back(-sizes[root], root);
    std::sort(order.begin(), order.end());
    for (const auto& [size, root] : order) {
      if (only >= 0 && root != only) continue;
      if (only < 0 && options_.choice == MapperChoice::kAuto && conflict_rounds_ == 0 &&
          -size < options_.auto_global)
        return false;
      const bool is_resumed = global_start_ && components.root(global_start_->image) == root;
      if (is_resumed && global_start_->step == GlobalStartState::kRefused) return false;
      make_mapper(components, root);
      const std::vector<const Pair*> chosen = pairs_at(pairs_of[root]);
      const GlobalStart start =
          start_globally(input_.cameras, mapper_->model().images, chosen, options_, stop_,
                         {.save_checkpoint =
                              [&](GlobalStartState state) {
                                global_start_ = std::move(state);
                                save_checkpoint_if_due();
                              },
                          .resume_from = is_resumed ? &*global_start_ : nullptr});
      result_.log.insert(result_.log.end(), start.log.begin(), start.log.end());
      if (start.refusal.empty()) {
        for (std::size_t k = 0; k < chosen.size(); ++k)
          if (start.rejections[k] != PairRejection::kNone)
            remaining_.reject(pairs_of[root][k], start.rejections[k]);
        Components remaining = this->components();
        make_mapper(remaining, remaining.root(first_registered(start.model)));
        mapper_->resume(start.model);
        begin_growing();
        is_global_ = true;
        return true;
      }
      mapper_.reset();
      const std::string failure = fmt::format("{}{}", kGlobalFailure, start.refusal);
      result_.log.push_back(failure);
      global_failed_ = true;
      global_start_.reset();
      if (options_.choice != MapperChoice::kGlobal) {
        // Prevents another attempt and log line after resuming from a checkpoint.
        GlobalStartState& refused = global_start_.emplace();
        refused.image = chosen.front()->first;
        refused.step = GlobalStartState::kRefused;
        return false;
      }
      if (result_.no_model.empty()) result_.no_model = failure;
      for (const std::size_t k : pairs_of[root])
        remaining_.reject(k, PairRejection::kBadInitialPair);
      for (std::size_t i = 0; i < input_.images.size(); ++i)
        if (components.root(static_cast<int>(i)) == root) result_.outcomes[i].reason = failure;
    }
    return false;
  }

  [[nodiscard]] std::vector<const Pair*> pairs_at(const std::vector<std::size_t>& indices) const {
    std::vector<const Pair*> pairs;
    pairs.reserve(indices.size());
    for (const std::size_t k : indices) pairs.push_back(&input_.pairs[k]);
    return pairs;
  }

  // The unfinished model of a global start, if it has positions.
  std::optional<Model> rough_model() {
    if (!global_start_) return std::nullopt;
    Components components = this->components();
    const int root = components.root(global_start_->image);
    Model model = remaining_.model_of(components, root);
    std::optional<PartialGlobalModel> rough =
        partial_model(*global_start_, input_.cameras, model.images,
                      pairs_at(remaining_.pairs_by_component(components)[root]), options_);
    if (!rough) return std::nullopt;
    IncrementalMapper mapper(std::move(model), std::move(rough->tracks), input_.descriptors,
                             input_.kind, options_);
    mapper.restore(
        {.model = packed(rough->model), .ray_cameras = rough->model.cameras, .tracks = {}});
    return mapper.finished(input_.colors);
  }

  // --- a start model ---

  // Fixes the poses and cameras of the start model.
  void fix_start_poses() {
    std::vector<int> images;
    for (std::size_t i = 0; i < start_.fits.size() && input_.start->fixed; ++i)
      if (start_.fits[i] != 0) images.push_back(static_cast<int>(i));
    mapper_->fix(std::move(images), input_.start->fixed_cameras);
  }

  void reject_start(const std::string& reason) {
    result_.no_model = kStartRefusal + reason;
    result_.log.push_back(result_.no_model);
  }

  // Begins with the start poses that agree with their matches; false: too few do.
  bool begin_with_start() {
    for (std::size_t i = 0; i < input_.images.size(); ++i)
      result_.outcomes[i].reason = start_.reasons[i];
    if (!start_.refusal.empty()) {
      reject_start(start_.refusal);
      return false;
    }
    result_.log.push_back(describe(start_, *input_.start, options_));
    const Model model = start_model(start_, *input_.start, input_);
    try {
      Components components = this->components();
      make_mapper(components, components.root(first_registered(model)));
      if (start_.is_exact() || input_.start->fixed) {
        mapper_->resume(model);
      } else {
        adjust_rough_start(*mapper_, model, options_, stop_);
        log_warnings();
      }
    } catch (const Interrupted&) {
      mapper_.reset();
      throw;
    }
    const std::string refusal =
        why_too_few_observations(mapper_->model(), start_, *input_.start, options_);
    if (!refusal.empty()) {
      reject_start(refusal);
      mapper_.reset();
      return false;
    }
    begin_growing();
    growth_.adjusted_at = 0;  // adjust the whole before adding images
    return true;
  }

  // Images that must not be added: those in finished models, and rejected ones of a fixed start
  // model.
  [[nodiscard]] std::vector<bool> excluded_images() const {
    std::vector<bool> result = remaining_.in_models();
    for (std::size_t i = 0; i < start_.fits.size() && input_.start->fixed; ++i)
      result[i] = result[i] || (input_.start->poses[i] && start_.fits[i] == 0);
    return result;
  }

  void begin_growing() {
    progress_.advance(mapper_->registered());
    growth_ = {};
    growth_.adjusted_at = mapper_->registered();
    is_global_ = false;
    global_start_.reset();
  }

  // Begins a model of the remaining images, globally or from an initial pair; false: no pair can
  // begin one.
  bool begin_model() {
    if (input_.start) return result_.models.empty() && begin_with_start();
    Components components = this->components();
    if (open_loop_model_ || options_.choice != MapperChoice::kIncremental || conflict_rounds_ > 0) {
      try {
        if (begin_globally(components, open_loop_model_
                                           ? components.root(first_registered(*open_loop_model_))
                                           : -1))
          return true;
      } catch (const Interrupted&) {
        mapper_.reset();
        throw;
      }
      if (open_loop_model_) {
        add_model(*std::exchange(open_loop_model_, std::nullopt));
        return begin_model();
      }
      if (options_.choice == MapperChoice::kGlobal) return false;
    }
    std::vector<std::pair<double, std::size_t>> starts;
    for (std::size_t k = 0; k < input_.pairs.size(); ++k) {
      if (!remaining_.contains(input_.pairs[k])) continue;
      const double score = initial_pair_score(input_.pairs[k], options_);
      if (score > 0 && remaining_.rejections()[k] == PairRejection::kNone)
        starts.emplace_back(-score, k);
    }
    std::sort(starts.begin(), starts.end());
    int mapper_root = -1;  // root of the component
    for (std::size_t k = 0; k < starts.size() && k < kMaxInitialPairs; ++k) {
      const Pair& pair = input_.pairs[starts[k].second];
      const int root = components.root(pair.first);
      std::string why;
      bool started = false;
      try {
        throw_if_stopped(stop_);
        if (root != mapper_root) make_mapper(components, root);
        mapper_root = root;
        started = mapper_->start(pair, stop_, why);
      } catch (const Interrupted&) {
        mapper_.reset();
        throw;
      }
      result_.log.push_back(fmt::format(
          "initial pair {} and {} ({} inliers, triangulation angle {:.1f} degrees, {:.0f} % "
          "explained by a homography): {}",
          input_.images[at(pair.first)].name, input_.images[at(pair.second)].name,
          pair.view.inliers.size(), pair.view.median_angle / kRadiansPerDegree,
          100.0 * pair.view.homography_inliers / static_cast<double>(pair.view.inliers.size()),
          started ? "accepted" : why));
      log_warnings();
      if (started) {
        begin_growing();
        return true;
      }
      remaining_.reject(pair, PairRejection::kBadInitialPair);
    }
    mapper_.reset();
    return false;
  }

  void grow() {
    sfm::grow(
        *mapper_, excluded_images(), growth_,
        {.step =
             [&] {
               if (input_.release_memory) input_.release_memory();
               save_checkpoint_if_due();
             },
         .attempted =
             [&](int image, bool added, const std::string& why) {
               if (added) {
                 result_.log.push_back(fmt::format("registered {}", input_.images[at(image)].name));
                 progress_.advance();
               }
               result_.outcomes[at(image)].reason = why;
             },
         .warning = [&](std::string line) { result_.log.push_back(std::move(line)); }},
        stop_);
    Model model = mapper_->finished(input_.colors);
    mapper_.reset();
    // A model grown image by image is always connected.
    if (const int left_out = is_global_ ? keep_largest_part(model) : 0; left_out > 0) {
      result_.log.push_back(
          fmt::format("{} images are removed from a model: they share too few points with two or "
                      "more of its other {} images",
                      left_out, statistics_of(model).registered));
    }
    if (input_.start) {
      add_model(std::move(model));
      return;
    }
    std::shared_ptr<const ModelConflicts> conflicts;
    if (reject_conflicts(model, conflicts)) {
      conflicting_model_ = std::move(model);
      return;
    }
    if (open_loop_model_) {
      add_model(better(*std::exchange(open_loop_model_, std::nullopt), std::move(model)));
    } else if (has_open_loops(model)) {
      open_loop_model_ = std::move(model);
    } else {
      add_model(std::move(model), std::move(conflicts));
    }
  }

  // `conflicts` of the model, where known.
  void add_model(Model model, std::shared_ptr<const ModelConflicts> conflicts = {}) {
    remaining_.add_finished(model);
    if (hooks_.watch) hooks_.watch(fmt::format("model-{}", result_.models.size()), model);
    result_.models.push_back(std::move(model));
    conflicts_.resize(result_.models.size() - 1);
    conflicts_.push_back(std::move(conflicts));
    conflicting_model_.reset();
    global_start_.reset();
  }

  // Whether an incrementally grown model has open loops. Then its images are mapped globally, which
  // distributes the error over the whole loop.
  bool has_open_loops(const Model& model) {
    if (is_global_ || options_.choice == MapperChoice::kGlobal) return false;
    if (global_failed_) return false;  // tried already
    const std::vector<const Pair*> open = open_loops(model, remaining_.pairs());
    if (open.empty()) return false;
    const Pair& strongest =
        **std::max_element(open.begin(), open.end(), [](const Pair* a, const Pair* b) {
          return a->view.inliers.size() < b->view.inliers.size();
        });
    result_.log.push_back(fmt::format(
        "a model of {} images does not close its loops: {} verified pairs contradict it (the "
        "strongest is {} and {}, with {} inliers); its images are mapped globally",
        statistics_of(model).registered, open.size(), input_.images[at(strongest.first)].name,
        input_.images[at(strongest.second)].name, strongest.view.inliers.size()));
    progress_.begin("reconstruct", static_cast<std::int64_t>(input_.images.size()), "images");
    return true;
  }

  // Of two models of the same images, the one that agrees with more verified matches.
  Model better(Model with_open_loops, Model global) {
    // Including matches that global mapping left out.
    std::vector<PairRejection> rejections = remaining_.rejections();
    remaining_.clear_cycle_rejections();
    const std::vector<const Pair*> remaining = remaining_.pairs();
    const double before = agreeing_inliers(with_open_loops, remaining);
    const double after = agreeing_inliers(global, remaining);
    result_.log.push_back(fmt::format(
        "inliers that agree with the incremental model: {:.0f}, with the global model: {:.0f}{}",
        before, after,
        after > before ? ": the global model is used" : ": the incremental model is used"));
    if (!(after > before)) {
      loop_stays_open_ = true;
      return with_open_loops;
    }
    remaining_.set_rejections(std::move(rejections));
    return global;
  }

  // Whether the model superimposes places. Then the responsible pairs are refused, and its images
  // are mapped again without them. That is done globally if possible, where a few remaining wrong
  // pairs do less harm. `conflicts`: those of the model, where computed.
  bool reject_conflicts(const Model& model, std::shared_ptr<const ModelConflicts>& conflicts) {
    if (input_.tracked || conflict_rounds_ >= kMaxConflictRounds) return false;
    conflicts = std::make_shared<const ModelConflicts>(model);
    if (!conflicts->any(is_repetitive())) return false;
    const std::vector<const Pair*> refused =
        conflicting_pairs(model, *conflicts, remaining_.pairs());
    if (refused.empty()) return false;
    for (const Pair* pair : refused) remaining_.reject(*pair, PairRejection::kModelConflict);
    // Pairs that contradicted the wrong ones may be right.
    remaining_.clear_cycle_rejections();
    ++conflict_rounds_;
    result_.log.push_back(
        fmt::format("a model of {} images superimposes different places ({} pairs of nearby images "
                    "contradict each other): {} matched pairs are rejected, and the images are "
                    "mapped again",
                    statistics_of(model).registered, conflicts->pairs().size(), refused.size()));
    progress_.begin("reconstruct", static_cast<std::int64_t>(input_.images.size()), "images");
    return true;
  }

  void log_warnings() {
    if (!mapper_) return;
    for (std::string& line : mapper_->take_warnings()) result_.log.push_back(std::move(line));
  }

  // --- checkpoints ---

  void save_checkpoint_if_due() {
    show_if_due();
    if (save_timer_.is_due(hooks_.save_interval_s)) save_checkpoint();
  }

  // Whether an incremental model is growing, as opposed to a global start.
  [[nodiscard]] bool is_growing() const { return mapper_ && mapper_->registered() > 0; }

  void show_if_due() {
    if (!hooks_.show || !is_growing()) return;
    if (show_timer_ && !show_timer_->is_due(hooks_.show_interval_s)) return;
    if (!show_timer_) show_timer_.emplace();
    show_timer_->run([&] { hooks_.show(mapper_->finished(input_.colors, 2)); });
  }

  void save_checkpoint() {
    if (hooks_.save_checkpoint) save_timer_.run([&] { hooks_.save_checkpoint(state()); });
  }

  [[nodiscard]] MapperState state() const {
    MapperState state;
    for (const Model& model : result_.models) state.models.push_back(packed(model));
    if (open_loop_model_) state.models.push_back(packed(*open_loop_model_));
    state.has_open_loop_model = open_loop_model_.has_value();
    state.is_global = is_global_;
    state.log = result_.log;
    for (const Outcome& outcome : result_.outcomes) state.reasons.push_back(outcome.reason);
    state.rejections = remaining_.rejections();
    state.done = done_;
    state.no_model = result_.no_model;
    state.conflict_rounds = conflict_rounds_;
    state.loop_stays_open = loop_stays_open_;
    state.global_failed = global_failed_;
    if (is_growing()) state.current = mapper_->state();
    state.start = global_start_;
    state.failed.assign(growth_.failed.begin(), growth_.failed.end());
    state.adjusted_at = growth_.adjusted_at;
    state.stage = growth_.stage;
    state.round = growth_.round;
    return state;
  }

  void resume(const MapperState& state) {
    result_.log = state.log;
    result_.no_model = state.no_model;
    conflict_rounds_ = state.conflict_rounds;
    loop_stays_open_ = state.loop_stays_open;
    global_failed_ = state.global_failed;
    for (std::size_t i = 0; i < input_.images.size(); ++i)
      result_.outcomes[i].reason = state.reasons[i];
    remaining_.set_rejections(state.rejections);
    done_ = state.done;
    for (const PackedModel& packed : state.models)
      result_.models.push_back(unpacked(packed, input_.images));
    if (state.has_open_loop_model) {
      open_loop_model_ = std::move(result_.models.back());
      result_.models.pop_back();
    }
    for (const Model& model : result_.models) remaining_.add_finished(model);
    is_global_ = state.is_global;
    global_start_ = state.start;
    if (state.current) {
      Components components = this->components();
      make_mapper(components, components.root(state.current->model.registered.front()));
      const std::size_t tracks = mapper_->model().points.size();
      if (static_cast<std::int64_t>(tracks) != state.current->model.points) {
        mapper_.reset();  // made from other pairs: start this model again
      } else {
        mapper_->restore(*state.current);
        growth_ = {};
        growth_.failed = {state.failed.begin(), state.failed.end()};
        growth_.adjusted_at = state.adjusted_at;
        growth_.stage = state.stage;
        growth_.round = state.round;
      }
    }
    result_.resumed = mapper_ ? mapper_->registered() : 0;
    for (const bool used : remaining_.in_models()) result_.resumed += used ? 1 : 0;
    progress_.advance(result_.resumed);
    if (!mapper_ && global_start_)
      result_.resumed += static_cast<int>(global_start_->model.registered.size());
  }

  const MapperInput& input_;
  const MapperOptions& options_;
  Progress& progress_;
  const std::stop_token& stop_;
  const MapperHooks& hooks_;
  Reconstruction result_;
  std::vector<std::shared_ptr<const ModelConflicts>> conflicts_;  // for result_.models, where known
  std::vector<PairEvidence> evidence_;
  RemainingImages remaining_;
  StartCheck start_;  // for input_.start
  bool done_ = false;
  std::optional<IncrementalMapper> mapper_;
  Growth growth_;  // of the model of mapper_
  int adjustments_ = 0;
  int conflict_rounds_ = 0;       // number of models rejected because of conflicts
  bool loop_stays_open_ = false;  // a model has open loops and was not improved by global mapping
  bool global_failed_ = false;    // global mapping of some images was refused
  std::optional<Model> open_loop_model_;  // has open loops; its images are mapped globally
  // A model rejected because of conflicts, until its images are mapped again. After an interruption
  // it is the result.
  std::optional<Model> conflicting_model_;
  bool is_global_ = false;  // how the model of mapper_ began
  // State of a global start of a component, or its refusal.
  std::optional<GlobalStartState> global_start_;
  IntervalTimer save_timer_;
  std::optional<IntervalTimer> show_timer_;  // from the first time on
};

}  // namespace

MappingResult map_images(const MapperInput& input, const MapperOptions& options, Progress& progress,
                         const std::stop_token& stop, const MapperHooks& hooks) {
  Mapping mapping(input, options, progress, stop, hooks);
  MappingResult result;
  result.reconstruction = mapping.run();
  result.is_repetitive = mapping.is_repetitive();
  return result;
}

}  // namespace tarsier::sfm
