// SPDX-License-Identifier: MIT
#include "tarsier/face/people/stored_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/people/gallery_index.h"
#include "tarsier/face/recognition/background_space.h"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <utility>

namespace tarsier::face::people {

namespace {

using recognition::Algorithm;
using recognition::Background;
using recognition::Recognizer;
using recognition::Rows;

// The stored templates of a space, one row per face (rising ids). Empty if one is missing or has
// another length.
std::optional<Rows> stored_rows(Gallery& gallery, std::int64_t space,
                                const std::vector<FaceRef>& refs, Eigen::Index length,
                                const std::map<std::int64_t, std::vector<float>>& own) {
  Rows rows(static_cast<Eigen::Index>(refs.size()), length);
  std::vector<bool> present(refs.size(), false);
  bool fits = true;
  const auto put = [&](std::int64_t face, std::span<const float> numbers) {
    const auto ref = std::lower_bound(refs.begin(), refs.end(), face,
                                      [](const FaceRef& a, std::int64_t id) { return a.id < id; });
    if (ref == refs.end() || ref->id != face) return;  // enrolled meanwhile
    fits = fits && static_cast<Eigen::Index>(numbers.size()) == length;
    if (!fits) return;
    const auto i = ref - refs.begin();
    rows.row(i) = Eigen::Map<const Eigen::RowVectorXf>(numbers.data(), length);
    present[static_cast<std::size_t>(i)] = true;
  };
  gallery.each_template(space, put);
  for (const auto& [face, numbers] : own) put(face, numbers);
  if (!fits || std::find(present.begin(), present.end(), false) != present.end())
    return std::nullopt;
  return rows;
}

// The recogniser of a stored model, with the background's network. Empty if it cannot be read, or
// has other directions than the background.
std::optional<Recognizer> stored_subspace(Gallery& gallery, const Background* background,
                                          const StoredModel& stored) {
  Recognizer subspace;
  try {
    subspace = recognition::recognizer_from_text(stored.body, gallery.path());
  } catch (const Error&) {
    return std::nullopt;
  }
  if (stored.space >= 0) return subspace;
  if (!has_directions(background) || stored.space != space_of(*background) ||
      subspace.options.algorithm !=
          (background->network ? Algorithm::kDeep : Algorithm::kDefault) ||
      subspace.mean.size() != background->mean.size())
    return std::nullopt;
  subspace.network = background->network;
  return subspace;
}

}  // namespace

Algorithm algorithm_of(Gallery& gallery) {
  try {
    return recognition::parse_algorithm(gallery.algorithm());
  } catch (const std::invalid_argument& error) {
    throw InputError(gallery.path(), error.what());
  }
}

bool has_directions(const Background* background) {
  return background != nullptr && background->basis.rows() > 0;
}

bool uses_coordinates(Algorithm algorithm, const Background* background, std::int64_t faces) {
  const bool deep = background != nullptr && background->network;
  if (algorithm == Algorithm::kDeep) {
    if (!deep)
      throw std::invalid_argument(
          "its templates are deep, but the embedding network is not installed: install it with "
          "scripts/get-model.sh face-embedding, or use option 'template' classic");
    return true;
  }
  return !deep && algorithm == Algorithm::kDefault && has_directions(background) &&
         faces > kMaxSmallGalleryFaces;
}

std::int64_t space_of(const Background& background) {
  return -recognition::fingerprint(background);
}

std::unordered_map<std::int64_t, std::string> names_of(Gallery& gallery) {
  std::unordered_map<std::int64_t, std::string> names;
  for (Person& person : gallery.people()) names.emplace(person.id, std::move(person.name));
  return names;
}

const std::string& name_of_person(const std::unordered_map<std::int64_t, std::string>& names,
                                  std::int64_t person, const std::string& path) {
  const auto found = names.find(person);
  if (found == names.end()) throw InputError(path, "a face of nobody: is damaged");
  return found->second;
}

void set_people(GalleryModel& model, const std::vector<FaceRef>& refs,
                const std::unordered_map<std::int64_t, std::string>& names,
                const std::string& path) {
  std::unordered_map<std::int64_t, int> index;
  model.faces.clear();
  model.people.clear();
  model.recognizer.labels.clear();
  model.recognizer.people.clear();
  for (const FaceRef& ref : refs) {
    const auto [entry, inserted] = index.try_emplace(ref.person, static_cast<int>(index.size()));
    if (inserted) {
      model.recognizer.labels.push_back(name_of_person(names, ref.person, path));
      model.people.push_back(ref.person);
    }
    model.recognizer.people.push_back(entry->second);
    model.faces.push_back(ref.id);
  }
}

void set_negatives(GalleryModel& model, Gallery& gallery) {
  Recognizer& recognizer = model.recognizer;
  std::map<std::int64_t, std::vector<float>> templates;
  std::vector<std::vector<float>*> rows;
  recognizer.negative_people.clear();
  for (const Negative& negative : gallery.negatives()) {
    const auto person = std::find(model.people.begin(), model.people.end(), negative.person);
    if (person == model.people.end()) continue;  // person without faces
    std::vector<float> numbers;
    if (const auto made = model.negatives.find(negative.id); made != model.negatives.end()) {
      numbers = std::move(made->second);
    } else {
      const cv::Mat crop = gallery.negative_crop(negative.id);
      if (crop.empty()) continue;  // removed meanwhile
      numbers = recognition::template_of(recognizer,
                                         recognizer_input(recognizer.options.algorithm, crop));
    }
    rows.push_back(&templates.emplace(negative.id, std::move(numbers)).first->second);
    recognizer.negative_people.push_back(static_cast<int>(person - model.people.begin()));
  }
  recognizer.negatives.resize(static_cast<Eigen::Index>(rows.size()), recognizer.template_length());
  for (std::size_t i = 0; i < rows.size(); ++i)
    recognizer.negatives.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVectorXf>(
        rows[i]->data(), static_cast<Eigen::Index>(rows[i]->size()));
  model.negatives = std::move(templates);
}

std::optional<GalleryModel> stored_model(Gallery& gallery, const Background* background,
                                         const StoredModel& stored,
                                         const std::vector<FaceRef>& refs,
                                         const std::map<std::int64_t, std::vector<float>>& own) {
  auto subspace = stored_subspace(gallery, background, stored);
  if (!subspace) return std::nullopt;
  GalleryModel model;
  model.recognizer = std::move(*subspace);
  model.id = stored.id;
  model.space = stored.space;
  if (stored.space < 0) {
    const auto rows =
        stored_rows(gallery, stored.space, refs, recognition::coordinate_count(*background), own);
    if (!rows) return std::nullopt;
    model.recognizer.templates =
        recognition::templates_of_coordinates(model.recognizer, *background, *rows);
  } else {
    auto rows = stored_rows(gallery, stored.space, refs, model.recognizer.template_length(), own);
    if (!rows) return std::nullopt;
    model.recognizer.templates = std::move(*rows);
  }
  set_people(model, refs, names_of(gallery), gallery.path());
  set_negatives(model, gallery);
  try {
    model.recognizer.check();
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
  model.recognizer.refresh();
  return model;
}

std::optional<GalleryModel> indexed_model(Gallery& gallery, const Background* background) {
  if (!has_directions(background)) return std::nullopt;
  const std::int64_t generation = gallery.generation();
  const std::optional<StoredModel> stored = gallery.model();
  if (!stored || stored->space >= 0) return std::nullopt;
  auto subspace = stored_subspace(gallery, background, *stored);
  if (!subspace) return std::nullopt;
  GalleryModel model;
  model.recognizer = std::move(*subspace);
  std::string unused_reason;
  model.index = GalleryIndex::open(gallery, *background, *stored, model.recognizer, unused_reason);
  if (!unused_reason.empty()) log_warning("{}", unused_reason);
  if (!model.index) return std::nullopt;
  if (index_is_outdated(model.index->newer()))
    log_info("{}: {} faces are newer than the index: `people index` makes the search faster",
             gallery.path(), model.index->newer());
  model.id = stored->id;
  model.space = stored->space;
  model.generation = generation;
  return model;
}

}  // namespace tarsier::face::people
