// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/remapping_checkpoint.h"

#include <algorithm>
#include <utility>

namespace tarsier::sfm {

RemappingCheckpoint::RemappingCheckpoint(const MapperInput& input, const MapperHooks& hooks)
    : hooks_(hooks) {
  if (!hooks.from || hooks.watch || !hooks.from->done ||
      !fits(*hooks.from, input.cameras, input.images, input.pairs.size()))
    return;
  patch_doubts_ = hooks.from->patch_doubts;
  tries_ = hooks.from->tries;
}

MapperHooks RemappingCheckpoint::first() {
  MapperHooks first = hooks_;
  if (hooks_.keep)
    first.keep = [this](const MapperState& state) {
      if (!state.done) return hooks_.keep(state);  // there are no further attempts yet
      first_ = state;
      keep();
    };
  return first;
}

MapperHooks RemappingCheckpoint::next_try() {
  MapperHooks next;
  next.keep_every_s = hooks_.keep_every_s;
  const std::size_t k = tried_++;
  if (k < tries_.size()) next.from = tries_[k];
  if (hooks_.keep)
    next.keep = [this, k](const MapperState& state) {
      tries_.resize(std::max(tries_.size(), k + 1));
      tries_[k] = state;
      keep();
    };
  return next;
}

void RemappingCheckpoint::keep_patch_doubts(std::vector<PatchDoubt> doubts) {
  patch_doubts_ = std::move(doubts);
  if (hooks_.keep) keep();
}

// Lends the later members to first_ while the caller writes it, since copies of models are large.
void RemappingCheckpoint::keep() {
  first_.patch_doubts = std::move(patch_doubts_);
  first_.tries = std::move(tries_);
  hooks_.keep(first_);
  patch_doubts_ = std::move(first_.patch_doubts);
  tries_ = std::move(first_.tries);
}

}  // namespace tarsier::sfm
