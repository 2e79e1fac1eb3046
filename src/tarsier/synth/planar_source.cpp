// SPDX-License-Identifier: MIT
#include "tarsier/synth/planar_source.h"

#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/synth/planar_images.h"

#include <fmt/format.h>

#include <charconv>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace tarsier::synth {
namespace {

template <typename Number>
bool parse_within(std::string_view text, Number least, Number most, Number& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && value >= least &&
         value <= most;
}

bool parse_flag(std::string_view text, bool& value) {
  value = text == "1";
  return text == "0" || text == "1";
}

}  // namespace

bool set_planar_source(std::string_view key, std::string_view value, PlanarSourceOptions& options,
                       bool& is_good) {
  VideoOptions& video = options.video;
  if (key == "family" && !options.posters) {
    options.family = value;
    is_good = true;  // find_dictionary() reports the error
  } else if (key == "prints") {
    is_good = parse_within(value, 1, 12, options.prints);
  } else if (key == "side" && !options.posters) {
    is_good = parse_within(value, 1e-3, 10.0, options.side);
  } else if (key == "speed") {
    is_good = parse_within(value, 0.0, 100.0, video.speed_px);
  } else if (key == "tilt") {
    is_good = parse_within(value, 0.0, 75.0, video.tilt_deg);
  } else if (key == "shutter") {
    is_good = parse_within(value, 0.0, 1.0, video.shutter);
  } else if (key == "exposure") {
    is_good = parse_within(value, 0.0, 0.8, video.exposure);
  } else if (key == "blur") {
    is_good = parse_within(value, 0.0, 20.0, video.imaging.defocus_px);
  } else if (key == "cover") {
    is_good = parse_flag(value, video.with_occluder);
  } else if (key == "distorted") {
    is_good = parse_flag(value, video.distorted);
  } else {
    return false;
  }
  return true;
}

PlanarPrint poster_print(int id, std::uint64_t seed) {
  PlanarPrint print;
  print.id = id;
  print.name = fmt::format("poster-{}", id);
  print.image = poster_image({600, 450}, seed * 1000003 + static_cast<std::uint64_t>(id));
  print.width = 0.2;
  return print;
}

PlanarVideo planar_source_video(const PlanarSourceOptions& options, cv::Size size, double fps,
                                std::uint64_t seed) {
  VideoOptions video = options.video;
  video.size = size;
  video.fps = fps;
  video.seed = seed;
  video.imaging.noise = 0;
  video.imaging.vignette = 0.2;
  video.imaging.slope = 0.3;
  video.imaging.slope_angle = 0.7;
  if (options.posters) {
    std::vector<PlanarPrint> prints;
    for (int i = 0; i < std::max(1, options.prints); ++i) prints.push_back(poster_print(i, seed));
    return print_video(std::move(prints), video);
  }
  return marker_video(planar::markers::find_dictionary(options.family),
                      options.prints > 0 ? options.prints : 4, options.side, video);
}

std::string planar_source_truth(const PlanarVideo& video, double time_s) {
  const geometry::Camera& camera = video.camera();
  nlohmann::json truth;
  truth["camera"] = {{"fx", camera.fx},
                     {"fy", camera.fy},
                     {"cx", camera.cx},
                     {"cy", camera.cy},
                     {"distortion", camera.distortion}};
  truth["markers"] = nlohmann::json::parse(truth_list(video.truth_at(time_s)));
  truth["rest"] = PlanarVideo::is_at_rest(time_s);
  return truth.dump();
}

}  // namespace tarsier::synth
