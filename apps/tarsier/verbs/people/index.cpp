// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/people/gallery_index.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include <cstdint>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct IndexFlags {
  PeopleFlags people;
  face::recognition::CellIndexOptions index;
  std::int64_t min_faces = face::people::kMinFacesForIndex;
  bool check = false;
};

// Checks that the gallery has an index, that it may be used, and that all its bytes are intact.
ExitStatus check_index(face::people::Gallery& gallery, Context& context) {
  const std::string path = face::people::index_path(gallery);
  face::people::GalleryIndexState state = face::people::gallery_index_state(gallery);
  if (state.current) {
    try {
      const face::recognition::CellIndex index(path);
      index.each_cell([](std::span<const std::int64_t>) {}, *context.progress, context.stop);
    } catch (const InputError& error) {
      state.current = false;
      state.unused_reason = std::string(error.what()).substr(path.size() + 2);
    }
  }
  if (context.json) {
    print_json(
        {{"index", path},
         {"there", state.exists},
         {"current", state.current},
         {"trouble", state.unused_reason.empty() ? nlohmann::ordered_json()
                                                 : nlohmann::ordered_json(state.unused_reason)},
         {"faces", state.faces},
         {"newer", state.newer}});
  } else if (!state.exists) {
    print_text(fmt::format("{}: no index: all faces are compared\n", printable(path)));
  } else if (!state.current) {
    print_text(
        fmt::format("{}: {}: all faces are compared\n", printable(path), state.unused_reason));
  } else {
    print_text(fmt::format(
        "{}: current: {} faces in it, {} newer{}\n", printable(path), state.faces, state.newer,
        face::people::index_is_outdated(state.newer) ? ": `people index` makes the search faster"
                                                     : ""));
  }
  return state.current ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

ExitStatus index_gallery(const IndexFlags& flags, Context& context) {
  if (flags.check) {
    face::people::Gallery gallery = face::open_gallery(flags.people.gallery);
    return check_index(gallery, context);
  }
  // A wrong path is always reported.
  if (!flags.people.background.empty()) static_cast<void>(find_background(flags.people));
  face::people::Gallery gallery = face::open_gallery_to_write(flags.people.gallery);
  face::resolve_template_kind(gallery, template_kind(flags.people), ModelStore::find(), false,
                              own_network(flags.people));
  const std::int64_t faces = gallery.face_count_up_to(flags.min_faces);
  if (faces < flags.min_faces) {
    log_info("{}: {} faces: with fewer than {} comparing all is as fast, no index is made",
             flags.people.gallery, faces, flags.min_faces);
    if (context.json)
      print_json({{"index", nullptr}, {"faces", faces}, {"min_faces", flags.min_faces}});
    return ExitStatus::kNothingFound;
  }
  const auto background = face::background_for(
      gallery, ModelStore::find(), background_of(flags.people), own_network(flags.people));
  if (!background)
    throw InputError(gallery.path(),
                     "--background none: the index needs the directions of a background");
  // Does the pending learning and computes missing templates.
  (void)face::train_gallery(gallery, &*background, face::people::TrainingPolicy::kIfNeeded,
                            *context.progress, context.stop, face::people::SearchMode::kNone);
  const auto report = face::people::build_gallery_index(gallery, *background, flags.index,
                                                        *context.progress, context.stop);
  if (context.json) {
    print_json({{"index", report.path},
                {"faces", report.faces},
                {"cells", report.index.cells},
                {"passes", report.index.passes},
                {"bytes", report.index.bytes}});
  } else {
    print_text(fmt::format("{}: {} faces in {} cells, {:.1f} MB\n", printable(report.path),
                           report.faces, report.index.cells,
                           static_cast<double>(report.index.bytes) / 1e6));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, IndexFlags& flags) {
  verb.add_option("GALLERY,--gallery", flags.people.gallery, "gallery file: the enrolled people")
      .show_default();
  verb.add_flag("--check", flags.check, "only check for a valid index; exit status 0: yes, 1: no");
  verb.add_option("--min-faces", flags.min_faces, "minimum number of faces for an index")
      .check(at_least(1))
      .show_default();
  bind_field(verb, flags.index, flags.index.memory_gb);
  bind_field(verb, flags.index, flags.index.cells);
  add_template_flags(verb, flags.people);
}

}  // namespace

void add_people_index(Command& area, Context& context) {
  add_verb<IndexFlags>(area, "index",
                       "build the index of a large gallery for `people identify` and `people live`",
                       context, add_flags, index_gallery);
}

}  // namespace tarsier::cli
