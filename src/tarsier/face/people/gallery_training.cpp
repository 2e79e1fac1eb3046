// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/people/gallery_index.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/people/stored_model.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/training.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <unordered_map>
#include <utility>

namespace tarsier::face::people {
namespace {

using recognition::Algorithm;
using recognition::Background;
using recognition::Recognizer;
using recognition::Rows;

using NamedTemplate = std::pair<std::int64_t, std::vector<float>>;

std::vector<float> template_for(Algorithm algorithm, const Background* background,
                                const Recognizer* model, const cv::Mat& crop) {
  if (model == nullptr) return recognition::coordinates_of(*background, crop);
  return recognition::template_of(*model, recognizer_input(algorithm, crop));
}

// The stored part of a model: subspace and calibration. Templates are stored separately.
std::string body_of(const Recognizer& model) {
  Recognizer subspace = model;
  subspace.labels.clear();
  subspace.people.clear();
  subspace.negatives.resize(0, model.template_length());
  subspace.negative_people.clear();
  subspace.templates.resize(0, model.template_length());
  return recognition::recognizer_text(subspace);
}

std::vector<float> row_of(const Rows& rows, Eigen::Index i) {
  return {rows.row(i).data(), rows.row(i).data() + rows.cols()};
}

}  // namespace

struct GalleryTraining::Impl {
  enum class Stage {
    kInspect,
    kNewestTemplates,
    kAllCoordinates,
    kRead,
    kTrain,
    kStore,
    kTemplates,
    kLoad,
    kDone
  };

  Impl(Gallery& of, const Background* general, bool may_store, TrainingPolicy training_policy,
       SearchMode mode)
      : gallery(of),
        background(general),
        store(may_store),
        policy(training_policy),
        search_mode(mode) {}

  Gallery& gallery;
  const Background* background;
  bool store;
  TrainingPolicy policy;
  SearchMode search_mode;

  Stage stage = Stage::kInspect;
  double work = 1;
  Algorithm algorithm = Algorithm::kDefault;
  bool coordinates = false;
  bool newest_computed = false;  // templates of faces that are newer than the index
  std::int64_t generation = 0;
  std::vector<FaceRef> refs;
  std::optional<StoredModel> stored;
  std::vector<std::int64_t> missing;  // faces whose templates must be computed
  std::size_t at = 0;
  std::map<std::int64_t, std::vector<float>> own;  // templates that may not be stored
  std::vector<std::int64_t> training_faces;        // training faces
  std::vector<cv::Mat> inputs;
  std::optional<recognition::Training> training;
  // Computes templates of missing faces, with the model `stored`.
  std::optional<Recognizer> recognizer;
  std::optional<GalleryModel> result;

  void inspect();
  void compute_missing_templates(Progress& progress, std::int64_t space, Stage following);
  void choose_training_faces();
  void read_training_faces();
  void finish_training();
  void load();
};

// Reads the state of the gallery and decides what to do.
void GalleryTraining::Impl::inspect() {
  generation = gallery.generation();
  algorithm = algorithm_of(gallery);
  const std::int64_t some = gallery.face_count_up_to(kMaxSmallGalleryFaces + 1);
  if (search_mode == SearchMode::kIndexed && policy == TrainingPolicy::kIfNeeded &&
      some > kMaxSmallGalleryFaces && uses_coordinates(algorithm, background, some)) {
    if ((result = indexed_model(gallery, background))) {
      missing =
          gallery.without_template_after(result->space, result->index->cells().metadata().last_id);
      stage = Stage::kDone;
      if (missing.empty() || !store || newest_computed) return;
      // For example, faces that were enrolled from a named group.
      newest_computed = true;
      result.reset();
      coordinates = true;
      stage = Stage::kNewestTemplates;
      return;
    }
  }
  refs = gallery.face_refs();
  if (refs.empty()) {
    stage = Stage::kDone;
    return;
  }
  const auto count = static_cast<std::int64_t>(refs.size());
  if (!recognition::is_whitened(algorithm) && count > kMaxClassical) {
    throw std::invalid_argument(fmt::format(
        "'{}' compares each face with each: at most {} faces, there are {}; give option "
        "'algorithm' default",
        recognition::name_of(algorithm), kMaxClassical, count));
  }
  coordinates = uses_coordinates(algorithm, background, count);
  stored = gallery.model();
  bool due = policy == TrainingPolicy::kAlways || !stored;
  if (coordinates) {
    due = due || stored->space != space_of(*background);
    // A small gallery of deep templates is trained again after each change; this takes moments.
    due = due || (algorithm == Algorithm::kDeep && count <= kMaxSmallGalleryFaces &&
                  stored->generation != generation);
  } else {
    // Train if the model is in coordinates that cannot be used here, or if faces have changed.
    due = due || stored->space < 0 ||
          (count <= recognition::kMaxTrainingFaces && stored->generation != generation);
  }
  if (due) stored.reset();
  if (coordinates) {
    missing = gallery.without_template(space_of(*background));
    stage = Stage::kAllCoordinates;
  } else if (due) {
    choose_training_faces();
    stage = Stage::kRead;
  } else {
    missing = gallery.without_template(stored->space);
    stage = Stage::kTemplates;
  }
  if (stored && !missing.empty() && stored->space > 0) {
    try {
      recognizer = recognition::recognizer_from_text(stored->body, gallery.path());
    } catch (const Error&) {
      stored.reset();
      choose_training_faces();
      stage = Stage::kRead;
    }
  }
  work = 1 + 1e-3 * static_cast<double>(refs.size());
}

// Computes some dozens of templates.
void GalleryTraining::Impl::compute_missing_templates(Progress& progress, std::int64_t space,
                                                      Stage following) {
  constexpr std::size_t kChunk = 32;
  if (at == 0 && !missing.empty())
    progress.begin("templates", static_cast<std::int64_t>(missing.size()), "faces");
  const std::size_t last = std::min(missing.size(), at + kChunk);
  std::vector<NamedTemplate> made;
  std::vector<cv::Mat> crops;
  for (; at < last; ++at) {
    if (auto face = gallery.face(missing[at])) {  // otherwise it was removed meanwhile
      made.emplace_back(face->id, std::vector<float>());
      crops.push_back(face->crop);
    }
  }
  cv::parallel_for_({0, static_cast<int>(made.size())}, [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const auto k = static_cast<std::size_t>(i);
      made[k].second =
          template_for(algorithm, background, recognizer ? &*recognizer : nullptr, crops[k]);
    }
  });
  if (!made.empty()) {
    if (store) {
      gallery.store_templates(space, made);
    } else {
      for (NamedTemplate& one : made) own.insert(std::move(one));
    }
    progress.advance(static_cast<std::int64_t>(made.size()));
  }
  work = 2 * static_cast<double>(made.size()) + 1;
  if (at < missing.size()) return;
  if (!missing.empty()) progress.end();
  missing.clear();
  at = 0;
  stage = following;
}

// Selects the training faces.
void GalleryTraining::Impl::choose_training_faces() {
  std::unordered_map<std::int64_t, int> index;
  std::vector<int> people;
  people.reserve(refs.size());
  for (const FaceRef& ref : refs)
    people.push_back(index.try_emplace(ref.person, static_cast<int>(index.size())).first->second);
  training_faces.clear();
  for (const std::size_t i : recognition::training_subset(people, recognition::kMaxTrainingFaces))
    training_faces.push_back(refs[i].id);
}

// Reads the training faces' crops in batches, or their coordinates; then training can start.
void GalleryTraining::Impl::read_training_faces() {
  const auto names = names_of(gallery);
  const auto label_of = [&](std::int64_t face) {
    const auto ref = std::lower_bound(refs.begin(), refs.end(), face,
                                      [](const FaceRef& a, std::int64_t id) { return a.id < id; });
    return name_of_person(names, ref->person, gallery.path());
  };
  std::vector<std::string> labels;
  recognition::RecognizerOptions options;
  options.algorithm = algorithm;
  work = static_cast<double>(training_faces.size()) / 2;
  if (coordinates) {
    const int length = recognition::coordinate_count(*background);
    Rows rows(static_cast<Eigen::Index>(training_faces.size()), length);
    Eigen::Index filled = 0;
    std::vector<std::int64_t> present;
    for (const std::int64_t face : training_faces) {
      std::vector<float> numbers = gallery.template_of(face, space_of(*background));
      if (numbers.empty())
        if (const auto made = own.find(face); made != own.end()) numbers = made->second;
      if (static_cast<int>(numbers.size()) != length) continue;  // removed meanwhile
      rows.row(filled++) = Eigen::Map<const Eigen::RowVectorXf>(numbers.data(), length);
      labels.push_back(label_of(face));
      present.push_back(face);
    }
    if (present.empty()) throw InputError(gallery.path(), "templates of faces are damaged");
    training_faces = std::move(present);
    training.emplace(Rows(rows.topRows(filled)), std::move(labels), options, *background);
    stage = Stage::kTrain;
    return;
  }
  constexpr std::size_t kChunk = 64;
  const std::size_t last = std::min(training_faces.size(), at + kChunk);
  for (; at < last; ++at) {
    auto face = gallery.face(training_faces[at]);
    if (!face) {  // removed meanwhile: restart
      inputs.clear();
      at = 0;
      stage = Stage::kInspect;
      return;
    }
    inputs.push_back(recognizer_input(algorithm, face->crop));
  }
  work = static_cast<double>(kChunk) / 2;
  if (at < training_faces.size()) return;
  at = 0;
  for (const std::int64_t face : training_faces) labels.push_back(label_of(face));
  const bool general = recognition::is_whitened(algorithm);
  if (!general) {
    // Classical recognisers need mirrored faces to handle faces turned to the other side.
    for (std::size_t i = 0, n = inputs.size(); i < n; ++i) {
      cv::Mat mirrored;
      cv::flip(inputs[i], mirrored, 1);
      inputs.push_back(mirrored);
      labels.push_back(labels[i]);
    }
  }
  training.emplace(std::exchange(inputs, {}), std::move(labels), options,
                   general ? background : nullptr, 2 * recognition::kMaxTrainingFaces);
  stage = Stage::kTrain;
}

void GalleryTraining::Impl::finish_training() {
  recognizer = training->take();
  training.reset();
  const auto own_count = static_cast<Eigen::Index>(training_faces.size());
  std::vector<NamedTemplate> templates;
  if (!coordinates) {  // templates of mirrored faces were only for training
    for (Eigen::Index i = 0; i < own_count; ++i)
      templates.emplace_back(training_faces[static_cast<std::size_t>(i)],
                             row_of(recognizer->templates, i));
  }
  stored.emplace();
  stored->body = body_of(*recognizer);
  stored->generation = generation;
  stored->space = coordinates ? space_of(*background) : 0;
  if (store) {
    const auto id =
        gallery.store_model(stored->body, generation, stored->space, training_faces, templates);
    if (!id) {  // a training face was removed meanwhile: discard the model
      recognizer.reset();
      stored.reset();
      stage = Stage::kInspect;
      return;
    }
    stored->id = *id;
    if (!coordinates) stored->space = *id;
    generation += 1;
  } else {
    own.insert(templates.begin(), templates.end());
  }
  if (!coordinates && refs.size() > training_faces.size()) {
    std::vector<std::int64_t> chosen = training_faces;
    std::sort(chosen.begin(), chosen.end());
    for (const FaceRef& ref : refs)
      if (!std::binary_search(chosen.begin(), chosen.end(), ref.id)) missing.push_back(ref.id);
  }
  stage = Stage::kTemplates;
}

void GalleryTraining::Impl::load() {
  // Other programs may have enrolled or forgotten people: read the current faces.
  generation = gallery.generation();
  std::vector<FaceRef> now = gallery.face_refs();
  std::erase_if(now, [&](const FaceRef& ref) {
    return !std::binary_search(refs.begin(), refs.end(), ref,
                               [](const FaceRef& a, const FaceRef& b) { return a.id < b.id; });
  });
  refs = std::move(now);
  work = 1 + 1e-2 * static_cast<double>(refs.size());
  stage = Stage::kDone;
  if (refs.empty() || search_mode == SearchMode::kNone) return;
  result = stored_model(gallery, background, *stored, refs, own);
  if (result) {
    result->generation = generation;
    return;
  }
  // Damaged: restart, with all templates computed from the faces.
  if (policy == TrainingPolicy::kAlways)
    throw InputError(gallery.path(), "templates of faces are damaged");
  policy = TrainingPolicy::kAlways;
  recognizer.reset();
  stage = Stage::kInspect;
}

GalleryTraining::GalleryTraining(Gallery& gallery, const Background* background, bool store,
                                 TrainingPolicy policy, SearchMode search_mode)
    : impl_(std::make_unique<Impl>(gallery, background, store, policy, search_mode)) {}
GalleryTraining::~GalleryTraining() = default;
GalleryTraining::GalleryTraining(GalleryTraining&&) noexcept = default;
GalleryTraining& GalleryTraining::operator=(GalleryTraining&&) noexcept = default;

double GalleryTraining::work() const { return impl_->work; }

bool GalleryTraining::step(Progress& progress, const std::stop_token& stop) {
  throw_if_stopped(stop);
  Impl& impl = *impl_;
  switch (impl.stage) {
    case Impl::Stage::kInspect:
      impl.inspect();
      break;
    case Impl::Stage::kNewestTemplates:
      impl.compute_missing_templates(progress, space_of(*impl.background), Impl::Stage::kInspect);
      break;
    case Impl::Stage::kAllCoordinates:
      impl.compute_missing_templates(progress, space_of(*impl.background),
                                     impl.stored ? Impl::Stage::kLoad : Impl::Stage::kRead);
      if (impl.stage == Impl::Stage::kRead) impl.choose_training_faces();
      break;
    case Impl::Stage::kRead:
      impl.read_training_faces();
      break;
    case Impl::Stage::kTrain:
      if (!impl.training->step(progress, stop)) impl.stage = Impl::Stage::kStore;
      impl.work = impl.training->work();
      break;
    case Impl::Stage::kStore:
      impl.finish_training();
      break;
    case Impl::Stage::kTemplates:
      impl.compute_missing_templates(progress, impl.stored->space, Impl::Stage::kLoad);
      break;
    case Impl::Stage::kLoad:
      impl.load();
      break;
    case Impl::Stage::kDone:
      return false;
  }
  return impl.stage != Impl::Stage::kDone;
}

std::optional<GalleryModel> GalleryTraining::take() {
  TARSIER_REQUIRE(impl_->stage == Impl::Stage::kDone, "the model is not there yet");
  return std::exchange(impl_->result, std::nullopt);
}

std::optional<GalleryModel> load_gallery_model(Gallery& gallery, const Background* background,
                                               bool store, TrainingPolicy policy,
                                               Progress& progress, const std::stop_token& stop,
                                               SearchMode search_mode) {
  GalleryTraining training(gallery, background, store, policy, search_mode);
  while (training.step(progress, stop)) {
  }
  return training.take();
}

std::optional<Recognizer> gallery_model(Gallery& gallery, const Background* background, bool store,
                                        Progress& progress, const std::stop_token& stop,
                                        TrainingPolicy policy) {
  auto model = load_gallery_model(gallery, background, store, policy, progress, stop);
  if (!model) return std::nullopt;
  return std::move(model->recognizer);
}

}  // namespace tarsier::face::people
