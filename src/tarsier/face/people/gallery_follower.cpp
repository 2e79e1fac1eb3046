// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/face/people/gallery_index.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/people/stored_model.h"
#include "tarsier/face/recognition/background_space.h"

#include <algorithm>
#include <utility>

namespace tarsier::face::people {

namespace {

using recognition::Background;
using recognition::Recognizer;
using recognition::Rows;

}  // namespace

TemplateExtractor::TemplateExtractor(Gallery& gallery, const Background* background)
    : gallery_(gallery), background_(background) {
  if (has_directions(background)) coordinates_ = space_of(*background);
}

void TemplateExtractor::refresh() {
  const std::int64_t generation = gallery_.generation();
  if (generation == generation_) return;
  generation_ = generation;
  in_coordinates_ = uses_coordinates(algorithm_of(gallery_), background_,
                                     gallery_.face_count_up_to(kMaxSmallGalleryFaces + 1));
  if (in_coordinates_) {
    recognizer_.reset();
    model_ = 0;
    return;
  }
  const std::int64_t id = gallery_.model_id();
  if (id == model_) return;
  model_ = id;
  recognizer_.reset();
  const std::optional<StoredModel> stored = gallery_.model();
  if (!stored || stored->space < 0) return;
  try {
    recognizer_ = recognition::recognizer_from_text(stored->body, gallery_.path());
  } catch (const Error&) {
    // The model is trained again on its next use.
  }
}

void TemplateExtractor::fill(StoredFace& face) {
  refresh();
  face.features.clear();
  face.space = 0;
  if (in_coordinates_) {
    face.features = recognition::coordinates_of(*background_, face.crop);
    face.space = coordinates_;
  } else if (recognizer_) {
    face.features = recognition::template_of(
        *recognizer_, recognizer_input(recognizer_->options.algorithm, face.crop));
    face.space = model_;
  }
}

GalleryFollower::GalleryFollower(Gallery& gallery, const Background* background,
                                 std::optional<GalleryModel> model, SearchMode search_mode)
    : gallery_(gallery), background_(background), search_mode_(search_mode) {
  replace(std::move(model));
}

void GalleryFollower::replace(std::optional<GalleryModel> model) {
  model_ = std::move(model);
  generation_ = model_ ? model_->generation : -1;
  if (search_mode_ == SearchMode::kIndexed) tried_index_ = gallery_.index_record();
}

void GalleryFollower::use_background(const Background* background) {
  background_ = background;
  generation_ = -1;
  tried_index_.clear();
}

GalleryFollower::Change GalleryFollower::update() {
  const std::int64_t generation = gallery_.generation();
  if (generation == generation_) return Change::kNone;
  generation_ = generation;
  const std::int64_t id = gallery_.model_id();
  if (model_ && model_->index) {
    if (model_->id == id && model_->index->update(model_->recognizer)) return Change::kFaces;
    // Use another index; if there is none, read all faces.
    if (load_index()) return Change::kModel;
    load_all_faces();
    return Change::kModel;
  }
  if (load_index()) return Change::kModel;
  if (id != 0 && (!model_ || model_->id != id)) {
    // Another program has trained. Use its model as soon as all its templates are stored.
    const std::optional<StoredModel> stored = gallery_.model();
    const std::vector<FaceRef> refs = gallery_.face_refs();
    if (stored && !refs.empty()) {
      if (auto model = stored_model(gallery_, background_, *stored, refs)) {
        model_ = std::move(model);
        return Change::kModel;
      }
    }
  }
  if (!model_) return Change::kNone;
  update_faces();
  return Change::kFaces;
}

bool GalleryFollower::load_index() {
  if (search_mode_ != SearchMode::kIndexed) return false;
  std::string record = gallery_.index_record();
  if (record.empty() || record == tried_index_) return false;
  tried_index_ = std::move(record);
  auto model = indexed_model(gallery_, background_);
  if (!model) return false;
  model_ = std::move(model);
  return true;
}

// Loads the stored model if all its templates are there. Otherwise keeps the current subspace with
// the faces that have templates.
void GalleryFollower::load_all_faces() {
  const std::vector<FaceRef> refs = gallery_.face_refs();
  const std::optional<StoredModel> stored = gallery_.model();
  if (stored && !refs.empty()) {
    if (auto model = stored_model(gallery_, background_, *stored, refs)) {
      model_ = std::move(model);
      return;
    }
  }
  model_->index.reset();
  model_->faces.clear();
  model_->recognizer.templates.resize(0, model_->recognizer.template_length());
  update_faces();
}

Recognition GalleryFollower::recognize(const std::vector<float>& features, double false_accepts) {
  TARSIER_REQUIRE(model_.has_value(), "nobody is enrolled");
  if (model_->index) {
    try {
      return model_->index->recognize(features, false_accepts);
    } catch (const InputError& error) {
      if (error.path() != index_path(gallery_)) throw;
      log_warning("{}: outdated, all faces are compared; rebuild it with `people index`",
                  error.what());
    }
    const std::int64_t id = model_->id;
    load_all_faces();
    if (!model_ || model_->id != id) return {};  // the template is of another model
  }
  return people::recognize(model_->recognizer, features, false_accepts);
}

bool GalleryFollower::is_enrolled(const std::string& name) const {
  if (!model_) return false;
  if (model_->index) return gallery_.find(name).has_value();
  const auto& labels = model_->recognizer.labels;
  return std::find(labels.begin(), labels.end(), name) != labels.end();
}

void GalleryFollower::update_faces() {
  const std::vector<FaceRef> refs = gallery_.face_refs();
  Recognizer& recognizer = model_->recognizer;
  // Kept templates first, then those of new faces, which have greater ids.
  std::vector<Eigen::Index> kept;
  std::vector<FaceRef> all;
  std::vector<std::vector<float>> added;
  std::size_t old = 0;
  for (const FaceRef& ref : refs) {
    while (old < model_->faces.size() && model_->faces[old] < ref.id) ++old;
    if (old < model_->faces.size() && model_->faces[old] == ref.id) {
      kept.push_back(static_cast<Eigen::Index>(old));
      all.push_back(ref);
      continue;
    }
    if (model_->space == 0) continue;
    std::vector<float> numbers = gallery_.template_of(ref.id, model_->space);
    if (numbers.empty()) continue;
    if (model_->space < 0) {
      if (static_cast<int>(numbers.size()) != recognition::coordinate_count(*background_)) continue;
      const Rows row = recognition::templates_of_coordinates(
          recognizer, *background_,
          Eigen::Map<const Rows>(numbers.data(), 1, static_cast<Eigen::Index>(numbers.size())));
      numbers.assign(row.data(), row.data() + row.size());
    }
    if (static_cast<int>(numbers.size()) != recognizer.template_length()) continue;
    added.push_back(std::move(numbers));
    kept.push_back(-static_cast<Eigen::Index>(added.size()));
    all.push_back(ref);
  }
  if (all.empty()) {
    model_.reset();
    return;
  }
  if (added.empty() && kept.size() == model_->faces.size()) {
    // The faces are the same, but their people or names may have changed.
    set_people(*model_, all, names_of(gallery_), gallery_.path());
    set_negatives(*model_, gallery_);
    recognizer.refresh();
    return;
  }
  Rows templates(static_cast<Eigen::Index>(kept.size()), recognizer.template_length());
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    if (kept[i] >= 0) {
      templates.row(row) = recognizer.templates.row(kept[i]);
    } else {
      const auto& numbers = added[static_cast<std::size_t>(-kept[i] - 1)];
      templates.row(row) = Eigen::Map<const Eigen::RowVectorXf>(
          numbers.data(), static_cast<Eigen::Index>(numbers.size()));
    }
  }
  recognizer.templates = std::move(templates);
  set_people(*model_, all, names_of(gallery_), gallery_.path());
  set_negatives(*model_, gallery_);
  recognizer.refresh();
}

}  // namespace tarsier::face::people
