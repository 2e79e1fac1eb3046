// SPDX-License-Identifier: MIT
#include "tarsier/synth/planar_source.h"

#include "tarsier/marker/dictionary.h"
#include "tarsier/synth/planar_pictures.h"

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
  FilmOptions& film = options.film;
  if (key == "family" && !options.posters) {
    options.family = value;
    is_good = true;  // find_dictionary() says what is wrong
  } else if (key == "prints") {
    is_good = parse_within(value, 1, 12, options.prints);
  } else if (key == "side" && !options.posters) {
    is_good = parse_within(value, 1e-3, 10.0, options.side);
  } else if (key == "speed") {
    is_good = parse_within(value, 0.0, 100.0, film.speed_px);
  } else if (key == "tilt") {
    is_good = parse_within(value, 0.0, 75.0, film.tilt_deg);
  } else if (key == "shutter") {
    is_good = parse_within(value, 0.0, 1.0, film.shutter);
  } else if (key == "exposure") {
    is_good = parse_within(value, 0.0, 0.8, film.exposure);
  } else if (key == "blur") {
    is_good = parse_within(value, 0.0, 20.0, film.look.defocus_px);
  } else if (key == "cover") {
    is_good = parse_flag(value, film.cover);
  } else if (key == "distorted") {
    is_good = parse_flag(value, film.distorted);
  } else {
    return false;
  }
  return true;
}

PlanarPrint poster_print(int id, std::uint64_t seed) {
  PlanarPrint print;
  print.id = id;
  print.name = fmt::format("poster-{}", id);
  print.picture = poster_picture({600, 450}, seed * 1000003 + static_cast<std::uint64_t>(id));
  print.width = 0.2;
  return print;
}

PlanarFilm planar_source_film(const PlanarSourceOptions& options, cv::Size size, double fps,
                              std::uint64_t seed) {
  FilmOptions film = options.film;
  film.size = size;
  film.fps = fps;
  film.seed = seed;
  film.look.noise = 0;
  film.look.vignette = 0.2;
  film.look.slope = 0.3;
  film.look.slope_angle = 0.7;
  if (options.posters) {
    std::vector<PlanarPrint> prints;
    for (int i = 0; i < std::max(1, options.prints); ++i) prints.push_back(poster_print(i, seed));
    return print_film(std::move(prints), film);
  }
  return marker_film(marker::find_dictionary(options.family),
                     options.prints > 0 ? options.prints : 4, options.side, film);
}

std::string planar_source_truth(const PlanarFilm& film, double time_s) {
  const geometry::Camera& camera = film.camera();
  nlohmann::json truth;
  truth["camera"] = {{"fx", camera.fx},
                     {"fy", camera.fy},
                     {"cx", camera.cx},
                     {"cy", camera.cy},
                     {"distortion", camera.distortion}};
  truth["markers"] = nlohmann::json::parse(truth_list(film.truth_at(time_s)));
  truth["rest"] = PlanarFilm::is_at_rest(time_s);
  return truth.dump();
}

}  // namespace tarsier::synth
