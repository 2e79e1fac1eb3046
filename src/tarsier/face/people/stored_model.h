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

// Builds a model from the stored data of a gallery. Internal to this module.
namespace tarsier::face::people {

// Throws InputError for a gallery with an unknown algorithm.
[[nodiscard]] recognition::Algorithm algorithm_of(Gallery& gallery);

[[nodiscard]] bool has_directions(const recognition::Background* background);

// Whether faces are stored as coordinates. Throws std::invalid_argument for deep templates without
// their network.
[[nodiscard]] bool uses_coordinates(recognition::Algorithm algorithm,
                                    const recognition::Background* background, std::int64_t faces);

// The space of coordinates in its directions, see StoredModel.
[[nodiscard]] std::int64_t space_of(const recognition::Background& background);

// Names by person id.
[[nodiscard]] std::unordered_map<std::int64_t, std::string> names_of(Gallery& gallery);
// Throws InputError(path) if nobody has the id.
[[nodiscard]] const std::string& name_of_person(
    const std::unordered_map<std::int64_t, std::string>& names, std::int64_t person,
    const std::string& path);

// Sets the people of the faces, in the order of their first face.
void set_people(GalleryModel& model, const std::vector<FaceRef>& refs,
                const std::unordered_map<std::int64_t, std::string>& names,
                const std::string& path);

// Sets the negatives of the recogniser. Their templates depend on the model: they are computed
// here, once for each model. There are few, because each is a manual correction.
void set_negatives(GalleryModel& model, Gallery& gallery);

// Builds the model without training and without computing templates. `own`: templates that are not
// stored, by face. Empty if the stored data are inconsistent.
[[nodiscard]] std::optional<GalleryModel> stored_model(
    Gallery& gallery, const recognition::Background* background, const StoredModel& stored,
    const std::vector<FaceRef>& refs, const std::map<std::int64_t, std::vector<float>>& own = {});

// A stored model with the gallery's index. Empty if there is no usable index.
[[nodiscard]] std::optional<GalleryModel> indexed_model(Gallery& gallery,
                                                        const recognition::Background* background);

}  // namespace tarsier::face::people
