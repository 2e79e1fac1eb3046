// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/planar/markers/evaluation.h"
#include "tarsier/planar/markers/pose.h"
#include "tarsier/planar/markers/predefined.h"
#include "tarsier/synth/planar_worlds.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "framework/size_flag.h"
#include "measure.h"
#include <algorithm>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#ifdef TARSIER_WITH_APRILTAG
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#endif

namespace tarsier::cli {
namespace {

using Json = nlohmann::ordered_json;
using Detector = std::function<std::vector<planar::markers::Marker>(const cv::Mat& gray)>;

constexpr int kScenesPerLevel = 20;
constexpr double kSide = 0.1;  // m

Detector own_detector(const planar::markers::Dictionary& family) {
  auto workspace = std::make_shared<planar::markers::DetectWorkspace>();
  return [&family, workspace](const cv::Mat& gray) {
    return planar::markers::detect_markers(gray, family, {}, *workspace);
  };
}

Detector opencv_detector(const planar::markers::Dictionary& family) {
  return [&family](const cv::Mat& gray) {
    return planar::markers::detect_with_opencv(gray, family.name());
  };
}

#ifdef TARSIER_WITH_APRILTAG
// The AprilTag library, one thread; its corners are anticlockwise from the tag's lower left.
Detector apriltag_detector(float decimate) {
  struct Parts {
    apriltag_family_t* family = tag36h11_create();
    apriltag_detector_t* detector = apriltag_detector_create();
    Parts() { apriltag_detector_add_family(detector, family); }
    Parts(const Parts&) = delete;
    Parts& operator=(const Parts&) = delete;
    ~Parts() {
      apriltag_detector_destroy(detector);
      tag36h11_destroy(family);
    }
  };
  auto parts = std::make_shared<Parts>();
  parts->detector->quad_decimate = decimate;
  parts->detector->nthreads = 1;
  return [parts](const cv::Mat& gray) {
    // The library only reads the pixels, but its type has no const.
    image_u8_t image{gray.cols, gray.rows, static_cast<std::int32_t>(gray.step[0]),
                     const_cast<std::uint8_t*>(gray.ptr<std::uint8_t>())};
    zarray_t* found = apriltag_detector_detect(parts->detector, &image);
    std::vector<planar::markers::Marker> markers;
    for (int i = 0; i < zarray_size(found); ++i) {
      apriltag_detection_t* tag = nullptr;
      zarray_get(found, i, static_cast<void*>(&tag));
      planar::markers::Marker one;
      one.id = tag->id;
      // There pixel centres are at halves, and the tags are upside down.
      constexpr std::size_t kFirst = 5;
      for (std::size_t k = 0; k < 4; ++k)
        one.corners[k] = {tag->p[(kFirst - k) % 4][0] - 0.5, tag->p[(kFirst - k) % 4][1] - 0.5};
      markers.push_back(std::move(one));
    }
    apriltag_detections_destroy(found);
    return markers;
  };
}
#endif

// Scenes are rendered once and shared by the methods.
struct Scenes {
  std::vector<cv::Mat> images;
  std::vector<planar::markers::MarkerTruth> truth;
};

Scenes scenes_of(const planar::markers::Dictionary& family, cv::Size size, std::uint64_t seed,
                 Context& context) {
  Scenes scenes;
  synth::StillOptions options;
  options.size = size;
  for (const auto level :
       {synth::PlanarLevel::kEasy, synth::PlanarLevel::kMedium, synth::PlanarLevel::kHard}) {
    for (int i = 0; i < kScenesPerLevel; ++i) {
      throw_if_stopped(context.stop);
      const synth::PlanarStill still = synth::marker_still(
          family, kSide, options, level,
          seed + 1000 * static_cast<std::uint64_t>(level) + static_cast<std::uint64_t>(i));
      planar::markers::MarkerTruth truth;
      truth.level = std::string(synth::name_of(level));
      truth.camera = still.camera;
      truth.size = kSide;
      for (const synth::PrintTruth& print : still.truth) {
        planar::markers::MarkerRecord one;
        one.id = print.id;
        one.corners = print.corners;
        one.side_px = print.side_px;
        one.pose = print.camera_from_print;
        truth.markers.push_back(one);
      }
      cv::Mat gray = still.image;
      if (gray.channels() == 3) cv::cvtColor(still.image, gray, cv::COLOR_BGR2GRAY);
      scenes.images.push_back(gray);
      scenes.truth.push_back(std::move(truth));
    }
  }
  return scenes;
}

planar::markers::MarkerScore measure(const Detector& detector, const Scenes& scenes, int repeats,
                                     Context& context) {
  planar::markers::MarkerEvaluator evaluator;
  for (std::size_t i = 0; i < scenes.images.size(); ++i) {
    throw_if_stopped(context.stop);
    std::vector<planar::markers::Marker> found;
    double best = 1e9;
    for (int repeat = 0; repeat < repeats; ++repeat) {
      const double start = thread_cpu_ms();
      found = detector(scenes.images[i]);
      best = std::min(best, thread_cpu_ms() - start);
    }
    std::vector<planar::markers::MarkerRecord> records;
    for (const planar::markers::PosedMarker& posed :
         planar::markers::pose_markers(std::move(found), kSide, scenes.truth[i].camera))
      records.push_back(planar::markers::record_of(posed.marker, posed.pose));
    evaluator.add(scenes.truth[i], records, best);
  }
  return evaluator.score();
}

void report(const std::string& method, const std::string& family, cv::Size size,
            const planar::markers::MarkerScore& score, const Context& context) {
  const auto three = [](double value) { return rounded(value, 3); };
  if (context.json) {
    print_json(Json{{"bench", "markers"},
                    {"case", fmt::format("{} {} {}x{}", method, family, size.width, size.height)},
                    {"method", method},
                    {"family", family},
                    {"size", fmt::format("{}x{}", size.width, size.height)},
                    {"scenes", score.images},
                    {"markers", score.truth},
                    {"recall", three(score.recall())},
                    {"precision", three(score.precision())},
                    {"corner_px", three(score.corner_px)},
                    {"rotation_deg", three(score.rotation_deg)},
                    {"flips_percent", three(score.flips_percent)},
                    {"ms", three(score.ms)}});
    return;
  }
  print_text(fmt::format(
      "{:10} {:15} {:>9}  recall {:.3f}  precision {:.3f}  corners {:.3f} px  rotation {:.2f} "
      "degrees  flips {:.1f} %  {:.2f} ms\n",
      method, family, fmt::format("{}x{}", size.width, size.height), score.recall(),
      score.precision(), score.corner_px, score.rotation_deg, score.flips_percent, score.ms));
}

}  // namespace

ExitStatus bench_markers(Context& context, const BenchOptions& options) {
  const std::vector<std::string> sizes =
      options.sizes.empty() ? std::vector<std::string>{"640x480", "1280x720"} : options.sizes;
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const int repeats = std::clamp(options.repeats, 1, 3);
  for (const std::string& text : sizes) {
    const cv::Size size = parse_size(text, 64, 8192);
    for (const char* name : {"aruco-original", "6x6_250", "36h11"}) {
      const planar::markers::Dictionary& family = planar::markers::find_dictionary(name);
      const Scenes scenes = scenes_of(family, size, context.seed, context);
      std::vector<std::pair<std::string, Detector>> methods{{"tarsier", own_detector(family)},
                                                            {"opencv", opencv_detector(family)}};
#ifdef TARSIER_WITH_APRILTAG
      if (std::string(name) == "36h11") {
        methods.emplace_back("apriltag", apriltag_detector(1));
        methods.emplace_back("apriltag/2", apriltag_detector(2));
      }
#endif
      for (const auto& [method, detector] : methods) {
        if (is_chosen(options, method))
          report(method, name, size, measure(detector, scenes, repeats, context), context);
      }
    }
  }
  cv::setNumThreads(threads);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
