// SPDX-License-Identifier: MIT
#include "tarsier/sfm/joining/joined_mapper.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/consistency/repeated_structure.h"
#include "tarsier/sfm/joining/join_models.h"
#include "tarsier/sfm/mapper/growth.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/interval_timer.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/model_parts.h"
#include "tarsier/sfm/mapper/outcomes.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <utility>

namespace tarsier::sfm {
namespace {

class JoinedMapping {
 public:
  JoinedMapping(const MapperInput& input, const MapperOptions& options, const MappedParts& mapped,
                Progress& progress, const std::stop_token& stop, const MapperHooks& hooks)
      : input_(input),
        options_(options),
        mapped_(mapped),
        progress_(progress),
        stop_(stop),
        hooks_(hooks) {}

  Reconstruction run() {
    check();
    made_.outcomes.resize(input_.images.size());
    for (const MappedPart& part : mapped_.parts) made_.parts.push_back(part.name);
    progress_.begin("join", static_cast<std::int64_t>(input_.images.size()), "images");
    if (input_.pairs.empty()) {
      join();
      finish_without_pairs();
    } else {
      evidence_ = check_evidence(input_.cameras, input_.images, input_.pairs);
      rejections_.assign(input_.pairs.size(), PairRejection::kNone);
      for (std::size_t k = 0; k < rejections_.size(); ++k)
        if (evidence_[k].is_refused()) rejections_[k] = PairRejection::kMissingFeatures;
      for (const std::size_t k : mapped_.refused_pairs)
        if (!is_refused(rejections_[k])) rejections_[k] = PairRejection::kModelConflict;
      if (is_resumable()) {
        resume(*hooks_.resume_from);
      } else {
        join();
        save_checkpoint();
      }
      while (at(grown_) < made_.models.size()) grow_further();
      save_checkpoint();
      const std::size_t count = made_.models.size();
      add_outcomes(input_, options_, evidence_, rejections_, false,
                   std::vector<std::shared_ptr<const ModelConflicts>>(count), made_);
    }
    progress_.end();
    return std::move(made_);
  }

 private:
  void check() const {
    for (const MappedPart& part : mapped_.parts) {
      TARSIER_REQUIRE(part.model.images.size() == input_.images.size() &&
                          part.model.cameras.size() == input_.cameras.size(),
                      "{}: {} images, expected {}", part.name, part.model.images.size(),
                      input_.images.size());
    }
    TARSIER_REQUIRE(mapped_.reasons.empty() || mapped_.reasons.size() == input_.images.size(),
                    "{} reasons for {} images", mapped_.reasons.size(), input_.images.size());
    for (const std::size_t k : mapped_.refused_pairs)
      TARSIER_REQUIRE(k < input_.pairs.size(), "pair {} of {}", k, input_.pairs.size());
  }

  // Joins the parts.
  void join() {
    made_.log = mapped_.log;
    for (std::size_t i = 0; i < mapped_.reasons.size(); ++i)
      made_.outcomes[i].reason = mapped_.reasons[i];
    std::vector<Model> models;
    models.reserve(mapped_.parts.size());
    for (const MappedPart& part : mapped_.parts) models.push_back(part.model);
    JoinOptions join_options;
    join_options.seed = options_.seed;
    JoinedModels joined = join_models(models, made_.parts, join_options, options_, stop_);
    made_.joins = std::move(joined.joins);
    for (const auto& [image, reason] : joined.left_out) made_.outcomes[at(image)].reason = reason;
    made_.log.insert(made_.log.end(), joined.log.begin(), joined.log.end());
    made_.models = std::move(joined.models);
  }

  // --- checkpoints ---

  [[nodiscard]] bool is_resumable() const {
    if (!hooks_.resume_from) return false;
    const MapperState& state = *hooks_.resume_from;
    const auto is_part = [&](int part) { return part >= 0 && at(part) < mapped_.parts.size(); };
    return fits(state, input_.cameras, input_.images, input_.pairs.size()) &&
           (!state.current || at(state.grown) < state.models.size()) &&
           std::all_of(state.joins.begin(), state.joins.end(), [&](const ModelJoin& join) {
             return is_part(join.first) && is_part(join.second);
           });
  }

  void resume(const MapperState& state) {
    made_.log = state.log;
    made_.joins = state.joins;
    for (std::size_t i = 0; i < made_.outcomes.size(); ++i)
      made_.outcomes[i].reason = state.reasons[i];
    for (const PackedModel& model : state.models)
      made_.models.push_back(unpacked(model, input_.images));
    grown_ = state.grown;
    resumed_ = state.current;
    if (resumed_) {
      growth_.failed = {state.failed.begin(), state.failed.end()};
      growth_.adjusted_at = state.adjusted_at;
      growth_.stage = state.stage;
      growth_.round = state.round;
    }
    for (const PackedModel& model : state.models)
      made_.resumed += static_cast<int>(model.registered.size());
  }

  void save_checkpoint() {
    if (hooks_.save_checkpoint) timer_.run([&] { hooks_.save_checkpoint(state()); });
  }

  [[nodiscard]] MapperState state() const {
    MapperState state;
    for (const Model& model : made_.models) state.models.push_back(packed(model));
    state.log = made_.log;
    for (const Outcome& outcome : made_.outcomes) state.reasons.push_back(outcome.reason);
    state.rejections = rejections_;
    state.joins = made_.joins;
    state.grown = grown_;
    state.done = at(grown_) == made_.models.size();
    if (!mapper_) return state;
    state.current = mapper_->state();
    state.failed.assign(growth_.failed.begin(), growth_.failed.end());
    state.adjusted_at = growth_.adjusted_at;
    state.stage = growth_.stage;
    state.round = growth_.round;
    return state;
  }

  // --- growth ---

  // Images that another model has.
  [[nodiscard]] std::vector<bool> registered_elsewhere(const std::vector<Model>& models,
                                                       std::size_t model) const {
    std::vector<bool> is_elsewhere(input_.images.size(), false);
    for (std::size_t m = 0; m < models.size(); ++m)
      for (std::size_t i = 0; i < is_elsewhere.size() && m != model; ++i)
        if (models[m].images[i].registered && !models[model].images[i].registered)
          is_elsewhere[i] = true;
    return is_elsewhere;
  }

  // Triangulates the next model's points from all pairs, and grows it to its end.
  void grow_further() {
    const std::vector<bool> is_elsewhere = registered_elsewhere(made_.models, at(grown_));
    Model& model = made_.models[at(grown_)];
    begin(model, is_elsewhere);
    progress_.advance(mapper_->registered());
    GrowthHooks hooks;
    hooks.step = [&] {
      if (input_.release_memory) input_.release_memory();
      if (timer_.is_due(hooks_.save_interval_s)) save_checkpoint();
    };
    hooks.attempted = [&](int image, bool added, const std::string& why) {
      if (added) made_.log.push_back(fmt::format("registered {}", input_.images[at(image)].name));
      made_.outcomes[at(image)].reason = why;
    };
    hooks.warning = [&](std::string line) { made_.log.push_back(std::move(line)); };
    try {
      grow(*mapper_, is_elsewhere, growth_, hooks, stop_);
    } catch (const Interrupted&) {
      if (!growth_.between_states) save_checkpoint();
      throw;
    }
    model = mapper_->finished(input_.colors);
    if (const int left_out = keep_largest_part(model); left_out > 0)
      made_.log.push_back(
          fmt::format("{} images are removed from a joined model: they share too few points with "
                      "two or more other images",
                      left_out));
    mapper_.reset();
    ++grown_;
  }

  // Sets mapper_ and growth_ for a model, at its beginning or where a checkpoint was made.
  void begin(const Model& model, const std::vector<bool>& is_elsewhere) {
    std::vector<char> has_features(input_.images.size());
    for (std::size_t i = 0; i < has_features.size(); ++i) has_features[i] = is_elsewhere[i] ? 0 : 1;
    Model start = model_with_features(input_.cameras, input_.images, has_features);
    const std::vector<int> features = feature_counts(start);
    std::vector<const Pair*> pairs;
    for (std::size_t k = 0; k < input_.pairs.size(); ++k) {
      const Pair& pair = input_.pairs[k];
      if (!pair.view.inliers.empty() && !is_refused(rejections_[k]) &&
          !is_elsewhere[at(pair.first)] && !is_elsewhere[at(pair.second)])
        pairs.push_back(&pair);
    }
    mapper_.emplace(std::move(start), make_tracks(pairs, features), input_.descriptors, input_.kind,
                    options_);
    const std::optional<IncrementalMapperState> before = std::exchange(resumed_, std::nullopt);
    if (before &&
        before->model.points == static_cast<std::int64_t>(mapper_->model().points.size())) {
      mapper_->restore(*before);
      return;
    }
    mapper_->resume(model);
    growth_ = {};
    growth_.adjusted_at = mapper_->registered();
  }

  // For an input without pairs: only the models are known.
  void finish_without_pairs() {
    std::erase_if(made_.models, [&](const Model& model) {
      return statistics_of(model).registered < options_.min_images;
    });
    for (std::size_t m = 0; m < made_.models.size(); ++m) {
      for (std::size_t i = 0; i < input_.images.size(); ++i) {
        Outcome& outcome = made_.outcomes[i];
        if (outcome.registered || !made_.models[m].images[i].registered) continue;
        outcome.registered = true;
        outcome.model = static_cast<int>(m);
        outcome.reason.clear();
      }
    }
    if (made_.models.empty()) made_.no_model = "none of the parts has a model";
  }

  const MapperInput& input_;
  const MapperOptions& options_;
  const MappedParts& mapped_;
  Progress& progress_;
  const std::stop_token& stop_;
  const MapperHooks& hooks_;
  Reconstruction made_;
  std::vector<PairEvidence> evidence_;
  std::vector<PairRejection> rejections_;
  int grown_ = 0;                            // number of models that have grown to their end
  std::optional<IncrementalMapper> mapper_;  // of the next one
  Growth growth_;
  std::optional<IncrementalMapperState> resumed_;  // the state of mapper_ in a checkpoint
  IntervalTimer timer_;
};

}  // namespace

Reconstruction map_joined(const MapperInput& input, const MapperOptions& options,
                          const MappedParts& mapped, Progress& progress,
                          const std::stop_token& stop, const MapperHooks& hooks) {
  options.check();
  return JoinedMapping(input, options, mapped, progress, stop, hooks).run();
}

}  // namespace tarsier::sfm
