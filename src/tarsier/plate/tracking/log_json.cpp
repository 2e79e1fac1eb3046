// SPDX-License-Identifier: MIT
// Entries of a log as JSON and CSV.
#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/name_table.h"
#include "tarsier/media/archive.h"
#include "tarsier/plate/tracking/log.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

nlohmann::ordered_json list_of(const std::string& text, const std::string& what,
                               const std::string& path) {
  try {
    return parse_json(text, path, {64'000'000, 8, 2'000'000});
  } catch (const InputError&) {
    throw InputError(path, what + " are not valid JSON");
  }
}

constexpr NameTable<LoggedPlate::State, 3> kLoggedStates{
    "state",
    {{{LoggedPlate::State::kClosed, "closed"},
      {LoggedPlate::State::kOpen, "open"},
      {LoggedPlate::State::kInterrupted, "interrupted"}}}};

std::string_view name_of(LoggedPlate::State state) { return kLoggedStates.name(state); }

}  // namespace

nlohmann::ordered_json logged_json(const LoggedPlate& plate, const std::string& path) {
  const std::string what = fmt::format("entry {}: its ", plate.id);
  nlohmann::ordered_json object{
      {"id", plate.id},
      {"text", plate.text},
      {"confidence", std::round(plate.confidence * 1e4) / 1e4},
      {"country",
       plate.country.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(plate.country)},
      {"source", plate.source},
      {"first_time", moment_text(plate.first_time)},
      {"last_time", moment_text(plate.last_time)},
      {"frames", plate.frames},
      {"box", {plate.box.x, plate.box.y, plate.box.width, plate.box.height}},
      {"candidates", list_of(plate.candidates, what + "candidates", path)},
      {"readings", list_of(plate.readings, what + "readings", path)},
      {"crop", plate.has_crop},
      {"state", name_of(plate.state)},
      {"correction", nullptr}};
  if (plate.correction) {
    object["correction"] = {{"text", plate.correction->text},
                            {"author", plate.correction->author},
                            {"time", moment_text(plate.correction->time)}};
  }
  if (!plate.synchronized) object["clock"] = "unsynchronized";
  return object;
}

nlohmann::ordered_json history_json(const PlateHistory& history, const PlateEvent& event) {
  const auto time_json = [&](Moment moment) {
    return history.visits == 0 ? nlohmann::ordered_json()
                               : nlohmann::ordered_json(moment_text(moment));
  };
  return {{"seen_before", history.visits},
          {"first_time", time_json(history.first_time)},
          {"last_time", time_json(history.last_time)},
          {"dwell", static_cast<double>((event.last_seen - event.first_seen).count()) / 1000}};
}

std::string logged_csv_header() {
  return csv_line({"id", "first_time", "last_time", "source", "text", "confidence", "country",
                   "frames", "x", "y", "w", "h", "state", "corrected", "author", "corrected_time"});
}

std::string logged_csv_line(const LoggedPlate& plate) {
  return csv_line({fmt::format("{}", plate.id), moment_text(plate.first_time),
                   moment_text(plate.last_time), plate.source, plate.text,
                   fmt::format("{:.4f}", plate.confidence), plate.country,
                   fmt::format("{}", plate.frames), fmt::format("{}", plate.box.x),
                   fmt::format("{}", plate.box.y), fmt::format("{}", plate.box.width),
                   fmt::format("{}", plate.box.height), std::string(name_of(plate.state)),
                   plate.correction ? plate.correction->text : "",
                   plate.correction ? plate.correction->author : "",
                   plate.correction ? moment_text(plate.correction->time) : ""});
}

}  // namespace tarsier::plate
