// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/recognizer.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

// From what a gallery stores to a model of it. Internal to this module.
namespace tarsier::face::people {

// Throws InputError: a gallery of an algorithm that is not known.
[[nodiscard]] recognition::Algorithm algorithm_of(Gallery& gallery);

[[nodiscard]] bool has_directions(const recognition::Background* background);

// Whether faces are kept as coordinates. Throws std::invalid_argument for deep templates without
// their network.
[[nodiscard]] bool uses_coordinates(recognition::Algorithm algorithm,
                                    const recognition::Background* background, std::int64_t faces);

// Of the coordinates in its directions, as StoredModel has it.
[[nodiscard]] std::int64_t space_of(const recognition::Background& background);

// By the id of each person.
[[nodiscard]] std::unordered_map<std::int64_t, std::string> names_of(Gallery& gallery);
// Throws InputError(path) where nobody has the id.
[[nodiscard]] const std::string& name_of_person(
    const std::unordered_map<std::int64_t, std::string>& names, std::int64_t person,
    const std::string& path);

// The people of the faces, in the order of their first face.
void put_people(GalleryModel& model, const std::vector<FaceRef>& refs,
                const std::unordered_map<std::int64_t, std::string>& names,
                const std::string& path);

// The faces that are not of a person, as the recogniser compares them. Their templates depend on
// what was learned: they are made here, once for each model. There are few: each was corrected by
// hand.
void put_negatives(GalleryModel& model, Gallery& gallery);

// Without learning or making anything. `own`: templates that are not stored, by face. Empty where
// what is stored does not fit together.
[[nodiscard]] std::optional<GalleryModel> stored_model(
    Gallery& gallery, const recognition::Background* background, const StoredModel& stored,
    const std::vector<FaceRef>& refs, const std::map<std::int64_t, std::vector<float>>& own = {});

// A stored model with the gallery's index. Empty where there is no index that can be used.
[[nodiscard]] std::optional<GalleryModel> indexed_model(Gallery& gallery,
                                                        const recognition::Background* background);

}  // namespace tarsier::face::people
