// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <memory>
#include <string_view>

namespace tarsier::synth {

// Synthetic sources with exact ground truth. The same text gives the same images (except live
// clocks):
//   NAME?size=640x480&fps=25&frames=100&seed=1&live=0&noise=2
//   scene      a still life under a slowly moving camera
//   portrait   a synthetic face that moves slightly; truth: "box" [x,y,w,h], "eyes", "mouth" (left
//              in the image first), "nose", px
//   car        a synthetic street with one or two cars, other ones in each frame; truth: "plates",
//              each with "id", "text", "corners" [[x,y]*4], "box" [x,y,w,h], "visible"
//   drive      a minute of a camera at a street: cars come and go, one is parked, one is far away;
//              truth as for car. Both: 1280x720; light=day|night|infrared,
//              kind=spain|europe|us|brazil|all; drive: seconds=60, cars=6, parked=1, far=1
//   board      a hand shows a calibration board, board=chess:9x6 (25 mm), holds and moves it;
//              truth: "camera"
//   clock      frame number and time of sending ("time_us"), readable by decode_clock() even
//              through JPEG
//   bars       a test card
// size: 16x16 .. 8192x8192 px. fps: (0, 1000]. frames: 0 is endless (default: 100, live: 0).
// live=1: frames come in real time and only the newest is kept, as from a camera. noise: standard
// deviation in grey levels, 0..64 (default: 2 for scene and portrait, otherwise 0).
// SourceOptions::width, height and fps set other defaults. Frame::truth is a JSON object with
// "source", "frame" and the members above. Throws InputError for an unknown name or key or a bad
// value; it lists the choices.
[[nodiscard]] std::unique_ptr<FrameSource> open_synth_source(std::string_view text,
                                                             const SourceOptions& options = {});

// "synth:", for open_source().
[[nodiscard]] Scheme synth_scheme();

}  // namespace tarsier::synth
