// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/remapping_checkpoint.h"

#include <algorithm>
#include <utility>

namespace tarsier::sfm {

RemappingCheckpoint::RemappingCheckpoint(const MapperInput& input, const MapperHooks& hooks)
    : hooks_(hooks) {
  if (!hooks.resume_from || hooks.watch || !hooks.resume_from->done ||
      !fits(*hooks.resume_from, input.cameras, input.images, input.pairs.size()))
    return;
  patch_rejections_ = hooks.resume_from->patch_rejections;
  attempts_ = hooks.resume_from->attempts;
}

MapperHooks RemappingCheckpoint::first() {
  MapperHooks first = hooks_;
  if (hooks_.save_checkpoint)
    first.save_checkpoint = [this](const MapperState& state) {
      if (!state.done) return hooks_.save_checkpoint(state);  // there are no further attempts yet
      first_ = state;
      save();
    };
  return first;
}

MapperHooks RemappingCheckpoint::next_attempt() {
  MapperHooks next;
  next.save_interval_s = hooks_.save_interval_s;
  const std::size_t k = next_index_++;
  if (k < attempts_.size()) next.resume_from = attempts_[k];
  if (hooks_.save_checkpoint)
    next.save_checkpoint = [this, k](const MapperState& state) {
      attempts_.resize(std::max(attempts_.size(), k + 1));
      attempts_[k] = state;
      save();
    };
  return next;
}

void RemappingCheckpoint::save_patch_rejections(std::vector<PatchRejection> rejections) {
  patch_rejections_ = std::move(rejections);
  if (hooks_.save_checkpoint) save();
}

// Lends the later members to first_ while the caller writes it, since copies of models are large.
void RemappingCheckpoint::save() {
  first_.patch_rejections = std::move(patch_rejections_);
  first_.attempts = std::move(attempts_);
  hooks_.save_checkpoint(first_);
  patch_rejections_ = std::move(first_.patch_rejections);
  attempts_ = std::move(first_.attempts);
}

}  // namespace tarsier::sfm
