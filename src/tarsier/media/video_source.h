// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace tarsier {

// Whether the first bytes of a file (512 or more if it has them) are those of a video: AVI,
// MP4/MOV, Matroska/WebM, MPEG (PS, TS, video), Ogg, FLV, ASF, Y4M, H.264/H.265 byte streams,
// MJPEG, GIF. False for playlists and texts that make FFmpeg open other files.
[[nodiscard]] bool looks_like_video(std::span<const std::uint8_t> bytes);

// A video file. Frames are read as fast as they are requested. Throws InputError if it cannot be
// opened or its first frame cannot be decoded.
[[nodiscard]] std::unique_ptr<FrameSource> make_video_source(const std::string& path,
                                                             const SourceOptions& options);

}  // namespace tarsier
