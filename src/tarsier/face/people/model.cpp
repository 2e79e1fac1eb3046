// SPDX-License-Identifier: MIT
#include "tarsier/face/people/model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/people/classical.h"
#include "tarsier/face/people/gallery_index.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/training.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <span>
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

// Whether faces are kept as coordinates. Throws std::invalid_argument for deep templates without
// their network.
bool uses_coordinates(Algorithm algorithm, const Background* background, std::int64_t faces) {
  const bool deep = background != nullptr && background->network;
  if (algorithm == Algorithm::kDeep) {
    if (!deep)
      throw std::invalid_argument(
          "its templates are deep, and the network that makes them is not there: "
          "scripts/get-model.sh face-embedding gets it, `people train --template classic` goes "
          "without");
    return true;
  }
  return !deep && algorithm == Algorithm::kDefault && has_directions(background) &&
         faces > kLearnedWhole;
}

std::int64_t space_of(const Background& background) {
  return -recognition::fingerprint(background);
}

// Who is who: names of people by id.
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

std::vector<float> template_for(Algorithm algorithm, const Background* background,
                                const Recognizer* model, const cv::Mat& crop) {
  if (model == nullptr) return recognition::coordinates_of(*background, crop);
  return recognition::template_of(*model, recognizer_input(algorithm, crop));
}

// The people of the faces, in the order of their first face.
void put_people(GalleryModel& model, const std::vector<FaceRef>& refs,
                const std::unordered_map<std::int64_t, std::string>& names,
                const std::string& path) {
  std::unordered_map<std::int64_t, int> index;
  model.faces.clear();
  model.people.clear();
  model.recognizer.labels.clear();
  model.recognizer.people.clear();
  for (const FaceRef& ref : refs) {
    const auto [entry, fresh] = index.try_emplace(ref.person, static_cast<int>(index.size()));
    if (fresh) {
      model.recognizer.labels.push_back(name_of_person(names, ref.person, path));
      model.people.push_back(ref.person);
    }
    model.recognizer.people.push_back(entry->second);
    model.faces.push_back(ref.id);
  }
}

// The faces that are not of a person, as the recogniser compares them. Their templates depend on
// what was learned: they are made here, once for each model. There are few: each was corrected by
// hand.
void put_negatives(GalleryModel& model, Gallery& gallery) {
  Recognizer& recognizer = model.recognizer;
  std::map<std::int64_t, std::vector<float>> templates;
  std::vector<std::vector<float>*> rows;
  recognizer.negative_people.clear();
  for (const Negative& negative : gallery.negatives()) {
    const auto person = std::find(model.people.begin(), model.people.end(), negative.person);
    if (person == model.people.end()) continue;  // without faces
    std::vector<float> numbers;
    if (const auto made = model.negatives.find(negative.id); made != model.negatives.end()) {
      numbers = std::move(made->second);
    } else {
      const cv::Mat crop = gallery.negative_crop(negative.id);
      if (crop.empty()) continue;  // gone meanwhile
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

// The stored templates of a space, a row for each of the faces, which rise. Nothing where one is
// missing or of another length.
std::optional<Rows> stored_rows(Gallery& gallery, std::int64_t space,
                                const std::vector<FaceRef>& refs, Eigen::Index length,
                                const std::map<std::int64_t, std::vector<float>>& own) {
  Rows rows(static_cast<Eigen::Index>(refs.size()), length);
  std::vector<bool> there(refs.size(), false);
  bool fits = true;
  const auto put = [&](std::int64_t face, std::span<const float> numbers) {
    const auto ref = std::lower_bound(refs.begin(), refs.end(), face,
                                      [](const FaceRef& a, std::int64_t id) { return a.id < id; });
    if (ref == refs.end() || ref->id != face) return;  // enrolled since
    fits = fits && static_cast<Eigen::Index>(numbers.size()) == length;
    if (!fits) return;
    const auto i = ref - refs.begin();
    rows.row(i) = Eigen::Map<const Eigen::RowVectorXf>(numbers.data(), length);
    there[static_cast<std::size_t>(i)] = true;
  };
  gallery.each_template(space, put);
  for (const auto& [face, numbers] : own) put(face, numbers);
  if (!fits || std::find(there.begin(), there.end(), false) != there.end()) return std::nullopt;
  return rows;
}

// What is stored, without learning or making anything. Nothing where it does not fit together.
std::optional<GalleryModel> stored_model(Gallery& gallery, const Background* background,
                                         const StoredModel& stored,
                                         const std::vector<FaceRef>& refs,
                                         const std::map<std::int64_t, std::vector<float>>& own) {
  GalleryModel model;
  try {
    model.recognizer = recognition::recognizer_from_text(stored.body, gallery.path());
  } catch (const Error&) {
    return std::nullopt;
  }
  model.id = stored.id;
  model.space = stored.space;
  if (stored.space < 0) {
    if (!has_directions(background) || stored.space != space_of(*background) ||
        model.recognizer.options.algorithm !=
            (background->network ? Algorithm::kDeep : Algorithm::kDefault) ||
        model.recognizer.mean.size() != background->mean.size())
      return std::nullopt;
    const auto rows =
        stored_rows(gallery, stored.space, refs, recognition::coordinate_count(*background), own);
    if (!rows) return std::nullopt;
    model.recognizer.network = background->network;
    model.recognizer.templates =
        recognition::templates_of_coordinates(model.recognizer, *background, *rows);
  } else {
    auto rows = stored_rows(gallery, stored.space, refs, model.recognizer.template_length(), own);
    if (!rows) return std::nullopt;
    model.recognizer.templates = std::move(*rows);
  }
  put_people(model, refs, names_of(gallery), gallery.path());
  put_negatives(model, gallery);
  try {
    model.recognizer.check();
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
  model.recognizer.refresh();
  return model;
}

// A stored model with the gallery's index. Nothing where there is none that can be used.
std::optional<GalleryModel> indexed_model(Gallery& gallery, const Background* background) {
  if (!has_directions(background)) return std::nullopt;
  const std::int64_t generation = gallery.generation();
  const std::optional<StoredModel> stored = gallery.model();
  if (!stored || stored->space != space_of(*background)) return std::nullopt;
  GalleryModel model;
  try {
    model.recognizer = recognition::recognizer_from_text(stored->body, gallery.path());
  } catch (const Error&) {
    return std::nullopt;
  }
  if (model.recognizer.mean.size() != background->mean.size() ||
      model.recognizer.options.algorithm !=
          (background->network ? Algorithm::kDeep : Algorithm::kDefault))
    return std::nullopt;
  model.recognizer.network = background->network;
  std::string trouble;
  model.index = GalleryIndex::open(gallery, *background, *stored, model.recognizer, trouble);
  if (!trouble.empty()) log_warning("{}", trouble);
  if (!model.index) return std::nullopt;
  if (index_is_behind(model.index->newer()))
    log_info("{}: {} faces are newer than the index: `people index` makes the search faster",
             gallery.path(), model.index->newer());
  model.id = stored->id;
  model.space = stored->space;
  model.generation = generation;
  return model;
}

// What is stored of a model: the subspace and the calibration. The templates are by themselves.
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

cv::Mat recognizer_input(Algorithm algorithm, const cv::Mat& crop) {
  return recognition::is_whitened(algorithm) ? crop : classical_face(crop);
}

struct GalleryTraining::Impl {
  enum class Stage {
    kLook,
    kNewest,
    kCoordinates,
    kRead,
    kTrain,
    kStore,
    kTemplates,
    kLoad,
    kDone
  };

  Impl(Gallery& of, const Background* general, bool may_store, Learn what, Searching how)
      : gallery(of), background(general), store(may_store), learn(what), searching(how) {}

  Gallery& gallery;
  const Background* background;
  bool store;
  Learn learn;
  Searching searching;

  Stage stage = Stage::kLook;
  double work = 1;
  Algorithm algorithm = Algorithm::kDefault;
  bool coordinates = false;
  bool newest_made = false;  // templates of faces that are newer than the index
  std::int64_t generation = 0;
  std::vector<FaceRef> refs;
  std::optional<StoredModel> stored;
  std::vector<std::int64_t> missing;  // faces whose templates are to be made
  std::size_t at = 0;
  std::map<std::int64_t, std::vector<float>> own;  // templates that may not be stored
  std::vector<std::int64_t> learned;               // faces that are learned from
  std::vector<cv::Mat> inputs;
  std::optional<recognition::Training> training;
  std::optional<Recognizer> recognizer;  // makes templates of missing faces, of `stored`
  std::optional<GalleryModel> result;

  void look();
  void make_missing(Progress& progress, std::int64_t space, Stage following);
  void choose();
  void read();
  void finish_training();
  void load();
};

// What there is and what is to be done.
void GalleryTraining::Impl::look() {
  generation = gallery.generation();
  algorithm = algorithm_of(gallery);
  if (searching == Searching::kByIndex && learn == Learn::kWhenDue &&
      uses_coordinates(algorithm, background, gallery.face_count_up_to(kLearnedWhole + 1)) &&
      gallery.face_count_up_to(kLearnedWhole + 1) > kLearnedWhole) {
    if ((result = indexed_model(gallery, background))) {
      missing = gallery.without_template_after(result->space, result->index->cells().label().last);
      stage = Stage::kDone;
      if (missing.empty() || !store || newest_made) return;
      // Of faces that were named from a group, say.
      newest_made = true;
      result.reset();
      coordinates = true;
      stage = Stage::kNewest;
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
        "'{}' compares each face with each: at most {} faces, there are {} (people train "
        "--algorithm default)",
        recognition::name_of(algorithm), kMaxClassical, count));
  }
  coordinates = uses_coordinates(algorithm, background, count);
  stored = gallery.model();
  bool due = learn == Learn::kNow || !stored;
  if (coordinates) {
    due = due || stored->space != space_of(*background);
    // Of a small gallery of deep templates: once more after each change, it takes moments.
    due = due || (algorithm == Algorithm::kDeep && count <= kLearnedWhole &&
                  stored->generation != generation);
  } else {
    // A model in coordinates that nobody can read here, and one of fewer faces than there are.
    due = due || stored->space < 0 ||
          (count <= recognition::kMaxLearnedFaces && stored->generation != generation);
  }
  if (due) stored.reset();
  if (coordinates) {
    missing = gallery.without_template(space_of(*background));
    stage = Stage::kCoordinates;
  } else if (due) {
    choose();
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
      choose();
      stage = Stage::kRead;
    }
  }
  work = 1 + 1e-3 * static_cast<double>(refs.size());
}

// Some dozens of templates.
void GalleryTraining::Impl::make_missing(Progress& progress, std::int64_t space, Stage following) {
  constexpr std::size_t kChunk = 32;
  if (at == 0 && !missing.empty())
    progress.begin("templates", static_cast<std::int64_t>(missing.size()), "faces");
  const std::size_t last = std::min(missing.size(), at + kChunk);
  std::vector<NamedTemplate> made;
  std::vector<cv::Mat> crops;
  for (; at < last; ++at) {
    if (auto face = gallery.face(missing[at])) {  // else it was removed meanwhile
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

// The faces that are learned from.
void GalleryTraining::Impl::choose() {
  std::unordered_map<std::int64_t, int> index;
  std::vector<int> people;
  for (const FaceRef& ref : refs)
    people.push_back(index.try_emplace(ref.person, static_cast<int>(index.size())).first->second);
  learned.clear();
  for (const std::size_t i : recognition::learning_sample(people, recognition::kMaxLearnedFaces))
    learned.push_back(refs[i].id);
}

// Their crops, some at a time; then the training can begin. Of coordinates: these.
void GalleryTraining::Impl::read() {
  const auto names = names_of(gallery);
  const auto label_of = [&](std::int64_t face) {
    const auto ref = std::lower_bound(refs.begin(), refs.end(), face,
                                      [](const FaceRef& a, std::int64_t id) { return a.id < id; });
    return name_of_person(names, ref->person, gallery.path());
  };
  std::vector<std::string> labels;
  recognition::RecognizerOptions options;
  options.algorithm = algorithm;
  work = static_cast<double>(learned.size()) / 2;
  if (coordinates) {
    const int length = recognition::coordinate_count(*background);
    Rows rows(static_cast<Eigen::Index>(learned.size()), length);
    Eigen::Index filled = 0;
    std::vector<std::int64_t> there;
    for (const std::int64_t face : learned) {
      std::vector<float> numbers = gallery.template_of(face, space_of(*background));
      if (numbers.empty())
        if (const auto made = own.find(face); made != own.end()) numbers = made->second;
      if (static_cast<int>(numbers.size()) != length) continue;  // removed meanwhile
      rows.row(filled++) = Eigen::Map<const Eigen::RowVectorXf>(numbers.data(), length);
      labels.push_back(label_of(face));
      there.push_back(face);
    }
    if (there.empty()) throw InputError(gallery.path(), "templates of faces are damaged");
    learned = std::move(there);
    training.emplace(Rows(rows.topRows(filled)), std::move(labels), options, *background);
    stage = Stage::kTrain;
    return;
  }
  constexpr std::size_t kChunk = 64;
  const std::size_t last = std::min(learned.size(), at + kChunk);
  for (; at < last; ++at) {
    auto face = gallery.face(learned[at]);
    if (!face) {  // removed meanwhile: from the beginning
      inputs.clear();
      at = 0;
      stage = Stage::kLook;
      return;
    }
    inputs.push_back(recognizer_input(algorithm, face->crop));
  }
  work = static_cast<double>(kChunk) / 2;
  if (at < learned.size()) return;
  at = 0;
  for (const std::int64_t face : learned) labels.push_back(label_of(face));
  const bool general = recognition::is_whitened(algorithm);
  if (!general) {
    // A classical recogniser has no other defence against faces that look the other way.
    for (std::size_t i = 0, n = inputs.size(); i < n; ++i) {
      cv::Mat mirrored;
      cv::flip(inputs[i], mirrored, 1);
      inputs.push_back(mirrored);
      labels.push_back(labels[i]);
    }
  }
  training.emplace(std::exchange(inputs, {}), std::move(labels), options,
                   general ? background : nullptr, 2 * recognition::kMaxLearnedFaces);
  stage = Stage::kTrain;
}

void GalleryTraining::Impl::finish_training() {
  recognizer = training->take();
  training.reset();
  const auto own_count = static_cast<Eigen::Index>(learned.size());
  std::vector<NamedTemplate> templates;
  if (!coordinates) {  // templates of mirrored faces were for learning
    for (Eigen::Index i = 0; i < own_count; ++i)
      templates.emplace_back(learned[static_cast<std::size_t>(i)],
                             row_of(recognizer->templates, i));
  }
  stored.emplace();
  stored->body = body_of(*recognizer);
  stored->generation = generation;
  stored->space = coordinates ? space_of(*background) : 0;
  if (store) {
    const auto id =
        gallery.store_model(stored->body, generation, stored->space, learned, templates);
    if (!id) {  // one of the faces was removed meanwhile: nothing of it may stay
      recognizer.reset();
      stored.reset();
      stage = Stage::kLook;
      return;
    }
    stored->id = *id;
    if (!coordinates) stored->space = *id;
    generation += 1;
  } else {
    own.insert(templates.begin(), templates.end());
  }
  if (!coordinates && refs.size() > learned.size()) {
    std::vector<std::int64_t> chosen = learned;
    std::sort(chosen.begin(), chosen.end());
    for (const FaceRef& ref : refs)
      if (!std::binary_search(chosen.begin(), chosen.end(), ref.id)) missing.push_back(ref.id);
  }
  stage = Stage::kTemplates;
}

void GalleryTraining::Impl::load() {
  // Others may have enrolled or forgotten meanwhile: these are the faces of now.
  generation = gallery.generation();
  std::vector<FaceRef> now = gallery.face_refs();
  std::erase_if(now, [&](const FaceRef& ref) {
    return !std::binary_search(refs.begin(), refs.end(), ref,
                               [](const FaceRef& a, const FaceRef& b) { return a.id < b.id; });
  });
  refs = std::move(now);
  work = 1 + 1e-2 * static_cast<double>(refs.size());
  stage = Stage::kDone;
  if (refs.empty() || searching == Searching::kNothing) return;
  result = stored_model(gallery, background, *stored, refs, own);
  if (result) {
    result->generation = generation;
    return;
  }
  // Damaged: once more from the beginning, from the faces alone.
  if (learn == Learn::kNow) throw InputError(gallery.path(), "templates of faces are damaged");
  learn = Learn::kNow;
  recognizer.reset();
  stage = Stage::kLook;
}

GalleryTraining::GalleryTraining(Gallery& gallery, const Background* background, bool store,
                                 Learn learn, Searching searching)
    : impl_(std::make_unique<Impl>(gallery, background, store, learn, searching)) {}
GalleryTraining::~GalleryTraining() = default;
GalleryTraining::GalleryTraining(GalleryTraining&&) noexcept = default;
GalleryTraining& GalleryTraining::operator=(GalleryTraining&&) noexcept = default;

double GalleryTraining::work() const { return impl_->work; }

bool GalleryTraining::step(Progress& progress, const std::stop_token& stop) {
  throw_if_stopped(stop);
  Impl& impl = *impl_;
  switch (impl.stage) {
    case Impl::Stage::kLook:
      impl.look();
      break;
    case Impl::Stage::kNewest:
      impl.make_missing(progress, space_of(*impl.background), Impl::Stage::kLook);
      break;
    case Impl::Stage::kCoordinates:
      impl.make_missing(progress, space_of(*impl.background),
                        impl.stored ? Impl::Stage::kLoad : Impl::Stage::kRead);
      if (impl.stage == Impl::Stage::kRead) impl.choose();
      break;
    case Impl::Stage::kRead:
      impl.read();
      break;
    case Impl::Stage::kTrain:
      if (!impl.training->step(progress, stop)) impl.stage = Impl::Stage::kStore;
      impl.work = impl.training->work();
      break;
    case Impl::Stage::kStore:
      impl.finish_training();
      break;
    case Impl::Stage::kTemplates:
      impl.make_missing(progress, impl.stored->space, Impl::Stage::kLoad);
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
                                               bool store, Learn learn, Progress& progress,
                                               const std::stop_token& stop, Searching searching) {
  GalleryTraining training(gallery, background, store, learn, searching);
  while (training.step(progress, stop)) {
  }
  return training.take();
}

std::optional<Recognizer> gallery_model(Gallery& gallery, const Background* background, bool store,
                                        Progress& progress, const std::stop_token& stop,
                                        Learn learn) {
  auto model = load_gallery_model(gallery, background, store, learn, progress, stop);
  if (!model) return std::nullopt;
  return std::move(model->recognizer);
}

TemplateMaker::TemplateMaker(Gallery& gallery, const Background* background)
    : gallery_(gallery), background_(background) {
  if (has_directions(background)) coordinates_ = space_of(*background);
}

void TemplateMaker::look() {
  const std::int64_t generation = gallery_.generation();
  if (generation == generation_) return;
  generation_ = generation;
  in_coordinates_ = uses_coordinates(algorithm_of(gallery_), background_,
                                     gallery_.face_count_up_to(kLearnedWhole + 1));
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
    // It is learned afresh when a model is next asked for.
  }
}

void TemplateMaker::fill(StoredFace& face) {
  look();
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
                                 std::optional<GalleryModel> model, Searching searching)
    : gallery_(gallery), background_(background), searching_(searching) {
  replace(std::move(model));
}

void GalleryFollower::replace(std::optional<GalleryModel> model) {
  model_ = std::move(model);
  generation_ = model_ ? model_->generation : -1;
  if (searching_ == Searching::kByIndex) tried_index_ = gallery_.index_record();
}

GalleryFollower::Change GalleryFollower::update() {
  const std::int64_t generation = gallery_.generation();
  if (generation == generation_) return Change::kNone;
  generation_ = generation;
  const std::int64_t id = gallery_.model_id();
  if (model_ && model_->index) {
    if (model_->id == id && model_->index->follow(model_->recognizer)) return Change::kFaces;
    // Another index; or none any more: then all faces are read.
    if (take_index()) return Change::kModel;
    read_all();
    return Change::kModel;
  }
  if (take_index()) return Change::kModel;
  if (id != 0 && (!model_ || model_->id != id)) {
    // Another program learned. Its model is taken as soon as all its templates are there.
    const std::optional<StoredModel> stored = gallery_.model();
    const std::vector<FaceRef> refs = gallery_.face_refs();
    if (stored && !refs.empty()) {
      if (auto model = stored_model(gallery_, background_, *stored, refs, {})) {
        model_ = std::move(model);
        return Change::kModel;
      }
    }
  }
  if (!model_) return Change::kNone;
  follow_faces();
  return Change::kFaces;
}

bool GalleryFollower::take_index() {
  if (searching_ != Searching::kByIndex) return false;
  std::string record = gallery_.index_record();
  if (record.empty() || record == tried_index_) return false;
  tried_index_ = std::move(record);
  auto model = indexed_model(gallery_, background_);
  if (!model) return false;
  model_ = std::move(model);
  return true;
}

// The model that is stored, with all templates; else the subspace that is known, with those of the
// faces that are there.
void GalleryFollower::read_all() {
  const std::vector<FaceRef> refs = gallery_.face_refs();
  const std::optional<StoredModel> stored = gallery_.model();
  if (stored && !refs.empty()) {
    if (auto model = stored_model(gallery_, background_, *stored, refs, {})) {
      model_ = std::move(model);
      return;
    }
  }
  model_->index.reset();
  model_->faces.clear();
  model_->recognizer.templates.resize(0, model_->recognizer.template_length());
  follow_faces();
}

Recognition GalleryFollower::recognize(const std::vector<float>& features, double false_accepts) {
  TARSIER_REQUIRE(model_.has_value(), "nobody is enrolled");
  if (model_->index) {
    try {
      return model_->index->recognize(features, false_accepts);
    } catch (const InputError& error) {
      if (error.path() != index_path(gallery_)) throw;
      log_warning("{}: not used any more, all faces are compared; `people index` makes it again",
                  error.what());
    }
    const std::int64_t id = model_->id;
    read_all();
    if (!model_ || model_->id != id) return {};  // the template is of another model
  }
  return people::recognize(model_->recognizer, features, false_accepts);
}

bool GalleryFollower::knows(const std::string& name) const {
  if (!model_) return false;
  if (model_->index) return gallery_.find(name).has_value();
  const auto& labels = model_->recognizer.labels;
  return std::find(labels.begin(), labels.end(), name) != labels.end();
}

void GalleryFollower::follow_faces() {
  const std::vector<FaceRef> refs = gallery_.face_refs();
  Recognizer& recognizer = model_->recognizer;
  // Templates that stay, then those of new faces, which have greater ids.
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
    // The same faces, but perhaps of other people, or under other names.
    put_people(*model_, all, names_of(gallery_), gallery_.path());
    put_negatives(*model_, gallery_);
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
  put_people(*model_, all, names_of(gallery_), gallery_.path());
  put_negatives(*model_, gallery_);
  recognizer.refresh();
}

Recognition recognition_of(const Recognizer& model, const recognition::PersonScore& best,
                           double false_accepts, int people) {
  TARSIER_REQUIRE(false_accepts > 0 && false_accepts < 1, "a rate of {}", false_accepts);
  Recognition out;
  out.label = model.labels[static_cast<std::size_t>(best.person)];
  out.score = best.score;
  out.nearest = best.nearest;
  if (!model.calibration) return out;
  const recognition::Calibration& calibration = *model.calibration;
  out.threshold = calibration.threshold(false_accepts, people);
  out.known = out.score >= out.threshold;
  const double slope = calibration.slope > 0 ? calibration.slope : 1 / calibration.scale;
  out.confidence = 1 / (1 + std::exp(-slope * (out.score - out.threshold)));
  return out;
}

Recognition recognize(const Recognizer& model, const std::vector<float>& features,
                      double false_accepts) {
  TARSIER_REQUIRE(false_accepts > 0 && false_accepts < 1, "a rate of {}", false_accepts);
  const auto found = recognition::best_person(model, features);
  if (!found) return {};
  return recognition_of(model, *found, false_accepts, static_cast<int>(model.labels.size()));
}

namespace {

constexpr double kSameRate = 0.001;

template <typename Name>
std::vector<std::string> often_taken_for(const std::vector<cv::Mat>& crops, const std::string& name,
                                         const Name& recognise) {
  std::map<std::string, std::size_t> taken_for;
  for (const cv::Mat& crop : crops) {
    const Recognition seen = recognise(crop);
    if (seen.known && seen.label != name) ++taken_for[seen.label];
  }
  std::vector<std::string> out;
  for (const auto& [label, count] : taken_for)
    if (2 * count > crops.size()) out.push_back(label);
  return out;
}

std::vector<float> template_of_crop(const Recognizer& model, const cv::Mat& crop) {
  return recognition::template_of(model, recognizer_input(model.options.algorithm, crop));
}

}  // namespace

std::vector<std::string> other_names(const Recognizer& model, const std::vector<cv::Mat>& crops,
                                     const std::string& name) {
  return often_taken_for(crops, name, [&](const cv::Mat& crop) {
    return recognize(model, template_of_crop(model, crop), kSameRate);
  });
}

std::vector<std::string> other_names(GalleryFollower& follower, const std::vector<cv::Mat>& crops,
                                     const std::string& name) {
  return often_taken_for(crops, name, [&](const cv::Mat& crop) {
    return follower.recognize(template_of_crop(*follower.recognizer(), crop), kSameRate);
  });
}

}  // namespace tarsier::face::people
