// SPDX-License-Identifier: MIT
#pragma once

#include "demo_page.h"
#include "framework/cli.h"

namespace tarsier::cli {

// Each function runs one area on images of this machine and adds its part to the page. Long work
// checks context.stop.
void demo_cartoon(Context& context, DemoPage& page);
void demo_plate(Context& context, DemoPage& page);
void demo_landmarks(Context& context, DemoPage& page);
void demo_aam(Context& context, DemoPage& page);
void demo_turning_head(Context& context, DemoPage& page);  // part of demo_pose
void demo_pose(Context& context, DemoPage& page);
void demo_people(Context& context, DemoPage& page);
void demo_calibrate(Context& context, DemoPage& page);
void demo_markers(Context& context, DemoPage& page);
void demo_targets(Context& context, DemoPage& page);
void demo_sfm(Context& context, DemoPage& page);

// Writes a video for browsers (MP4 with H.264); false if this OpenCV cannot write one.
[[nodiscard]] bool write_demo_video(const std::string& path, const std::vector<cv::Mat>& frames,
                                    double fps);

}  // namespace tarsier::cli
