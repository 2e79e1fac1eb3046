// SPDX-License-Identifier: MIT
#include "tarsier/face/people/export.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <cstddef>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

namespace tarsier::face::people {
namespace {

// The recursion depth of writing JSON grows with its nesting.
constexpr ArchiveLimits kMeasureLimits{100'000, 8, 1000};

}  // namespace

ExportReport export_gallery(Gallery& gallery, const std::string& target,
                            const std::function<std::string(std::int64_t)>& time_text,
                            const std::stop_token& stop) {
  ExportReport report;
  // Written atomically and readable by its owner only, like the gallery.
  AtomicFolder whole(target);
  const std::string& folder = whole.path();
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  std::string list;
  for (const Person& person : gallery.people()) {
    const std::string name = fmt::format("person-{}", person.id);
    make_folder(folder + "/" + name);
    nlohmann::ordered_json faces = nlohmann::ordered_json::array();
    // One at a time: the faces of a person may not fit into memory.
    gallery.each_face(person.id, true, [&](StoredFace&& face) {
      throw_if_stopped(stop);
      const std::string file = fmt::format("{}/face-{}.png", name, face.id);
      write_image(folder + "/" + file, face.crop);
      list += fmt::format("{}\t{}\n", file, person.name);
      nlohmann::ordered_json measures;  // null if the stored text is not valid JSON
      try {
        measures = parse_json(face.measures, gallery.path(), kMeasureLimits);
      } catch (const InputError&) {
        measures = nullptr;
      }
      faces.push_back({{"file", file},
                       {"quality", face.quality},
                       {"measures", std::move(measures)},
                       {"source", face.source},
                       {"time", time_text(face.time)}});
      ++report.faces;
    });
    all.push_back({{"name", person.name},
                   {"note", person.note},
                   {"time", time_text(person.time)},
                   {"faces", std::move(faces)},
                   {"sightings", nlohmann::ordered_json::array()}});
    ++report.people;
  }
  // Sightings with their stored faces; unknown ones by group.
  nlohmann::ordered_json unknown = nlohmann::ordered_json::array();
  std::map<std::string, std::size_t> index;
  for (std::size_t i = 0; i < all.size(); ++i) index[all[i]["name"].get<std::string>()] = i;
  bool has_folder = false;
  for (const Sighting& sighting : gallery.sightings()) {
    throw_if_stopped(stop);
    nlohmann::ordered_json entry = {{"time", time_text(sighting.time)},
                                    {"source", sighting.source},
                                    {"known", sighting.known},
                                    {"confidence", sighting.confidence}};
    if (const auto face = sighting.has_face ? gallery.sighting_face(sighting.id) : std::nullopt) {
      if (!std::exchange(has_folder, true)) make_folder(folder + "/seen");
      const std::string file = fmt::format("seen/sighting-{}.png", sighting.id);
      write_image(folder + "/" + file, face->crop);
      entry["file"] = file;
    }
    if (const auto person = sighting.known ? index.find(sighting.name) : index.end();
        person != index.end()) {
      all[person->second]["sightings"].push_back(std::move(entry));
    } else {
      entry["group"] =
          sighting.group > 0 ? nlohmann::ordered_json(sighting.group) : nlohmann::ordered_json();
      unknown.push_back(std::move(entry));
    }
  }
  nlohmann::ordered_json negatives = nlohmann::ordered_json::array();
  for (const bool overruled : {false, true}) {
    for (const Negative& negative :
         overruled ? gallery.overruled_negatives() : gallery.negatives()) {
      throw_if_stopped(stop);
      const cv::Mat crop = gallery.negative_crop(negative.id);
      if (crop.empty()) continue;  // removed meanwhile
      if (negatives.empty()) make_folder(folder + "/negatives");
      const std::string file = fmt::format("negatives/negative-{}.png", negative.id);
      write_image(folder + "/" + file, crop);
      negatives.push_back({{"not", gallery.name_of(negative.person)},
                           {"file", file},
                           {"overruled", overruled},
                           {"quality", negative.quality},
                           {"source", negative.source},
                           {"time", time_text(negative.time)}});
    }
  }
  nlohmann::ordered_json log = nlohmann::ordered_json::array();
  for (const Correction& entry : gallery.corrections()) log.push_back(to_json(entry, time_text));
  write_file_atomically(folder + "/faces.lst", std::string_view(list));
  const nlohmann::ordered_json object = {{"people", std::move(all)},
                                         {"unknown", std::move(unknown)},
                                         {"negatives", std::move(negatives)},
                                         {"log", std::move(log)}};
  write_file_atomically(
      folder + "/people.json",
      std::string_view(object.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) +
                       "\n"));
  whole.commit();
  return report;
}

nlohmann::ordered_json to_json(const Correction& entry,
                               const std::function<std::string(std::int64_t)>& time_text) {
  using Json = nlohmann::ordered_json;
  Json line = {{"correction", entry.id},
               {"time", time_text(entry.time)},
               {"who", entry.actor},
               {"what", entry.kind}};
  line["from"] = entry.from.empty() ? Json() : Json(entry.from);
  line["to"] = entry.to.empty() ? Json() : Json(entry.to);
  line["count"] = entry.count;
  line["undone"] = entry.undone > 0 ? Json(entry.undone) : Json();
  line["undoes"] = entry.undoes > 0 ? Json(entry.undoes) : Json();
  return line;
}

}  // namespace tarsier::face::people
