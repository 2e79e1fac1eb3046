// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/identifier.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/face/pipelines/landmark_tracker.h"
#include "tarsier/face/pipelines/template_error.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <list>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <utility>

namespace tarsier::face {
namespace {

constexpr const char* kShippedLandmarks = "landmarks68.json";
constexpr const char* kShippedBackground = "people-background.json";
constexpr const char* kDeepBackground = "people-deep.json";
constexpr const char* kDeepNetwork = "face-embedding.json";
constexpr std::string_view kDeepAlgorithm = "deep";
constexpr std::string_view kNoBackground = "none";

// The gallery's record of its network, "SHA256 NAME"; empty: the installed network.
std::string identity_of(const SharedNetwork& own) {
  return own ? own->sha256 + " " + own->name : std::string();
}
std::string_view sum_of(std::string_view identity) {
  return identity.substr(0, identity.find(' '));
}
// "face.onnx (SHA-256 0123456789ab..)"
std::string named_as(std::string_view identity) {
  const std::size_t space = std::min(identity.find(' '), identity.size());
  return fmt::format("{} (SHA-256 {}..)", identity.substr(std::min(space + 1, identity.size())),
                     identity.substr(0, std::min<std::size_t>(space, 12)));
}

}  // namespace

FaceReaderModel FaceReaderModel::load(const ModelStore& models, people::FaceReaderOptions options) {
  options.check();
  options.finder.detector.check();
  std::shared_ptr<const landmarks::LandmarkModel> landmarks;
  if (options.eyes == people::EyeMethod::kLandmarks) {
    if (models.has(kShippedLandmarks)) {
      landmarks = std::make_shared<const landmarks::LandmarkModel>(
          landmarks::read_landmark_model(models.path(kShippedLandmarks)));
    } else {
      log_warning("{}: not there; eyes are found by cascades instead",
                  models.expected_path(kShippedLandmarks));
      options.eyes = people::EyeMethod::kCascades;
    }
  }
  DetectorModel detector = DetectorModel::load(models, "", options.finder);
  FaceReaderModel model(std::move(options), std::move(detector));
  model.landmarks_ = std::move(landmarks);
  return model;
}

people::FaceReader FaceReaderModel::make_reader() const {
  return {options_, landmarks_, detector_.networks(), detector_.anchors()};
}

TemplateKind parse_template_kind(std::string_view name) {
  constexpr NameTable<TemplateKind, 3> kKinds{"template",
                                              {{{TemplateKind::kAuto, "auto"},
                                                {TemplateKind::kClassic, "classic"},
                                                {TemplateKind::kDeep, "deep"}}}};
  return kKinds.parse(name);
}

bool has_deep_templates(const ModelStore& models) { return models.has(kDeepNetwork); }

bool has_deep_templates(people::Gallery& gallery) { return gallery.algorithm() == kDeepAlgorithm; }

SharedNetwork load_deep_network(const ModelStore& models, const SharedNetwork& own) {
  if (own) return own;
  if (!models.has(kDeepNetwork)) {
    throw ModelError(kDeepNetwork,
                     "is not installed: install it with scripts/get-model.sh face-embedding (6 MB, "
                     "MIT), or use classic templates (option 'template')");
  }
  return std::make_shared<const recognition::DeepNetwork>(
      recognition::read_deep_network(models.path(kDeepNetwork)));
}

recognition::Background load_deep_background(const ModelStore& models, const std::string& which,
                                             const SharedNetwork& own) {
  SharedNetwork network = load_deep_network(models, own);
  if (own && which.empty())
    throw TemplateError(TemplateProblem::kNotCalibrated, own->name,
                        "is not calibrated, no background is given");
  const std::string path = models.path_or(which, kDeepBackground);
  recognition::Background background = recognition::read_background(path);
  if (background.network_fingerprint != network->fingerprint ||
      background.mean.size() != network->outputs()) {
    throw ModelError(path, background.network_fingerprint == 0
                               ? "was not trained on deep templates"
                               : "is of another network than " +
                                     (own ? own->name : models.expected_path(kDeepNetwork)));
  }
  background.network = std::move(network);
  return background;
}

void attach_network(recognition::Recognizer& model, SharedNetwork network,
                    const std::string& path) {
  const bool same =
      model.network_fingerprint == 0 || model.network_fingerprint == network->fingerprint;
  if (!same || model.mean.size() != network->outputs())
    throw ModelError(path, "was trained with another network" +
                               (network->name.empty() ? std::string() : " than " + network->name));
  model.network = std::move(network);
}

void use_deep_templates(people::Gallery& gallery, const SharedNetwork& own) {
  gallery.set_algorithm(kDeepAlgorithm);
  gallery.set_network(identity_of(own));
}

void resolve_template_kind(people::Gallery& gallery, TemplateKind kind, const ModelStore& models,
                           bool set_kind, const SharedNetwork& own) {
  const bool deep = has_deep_templates(gallery);
  if (gallery.face_count_up_to(1) > 0) {
    const std::string network = deep ? gallery.network() : std::string();
    if (own && network != identity_of(own)) {
      if (sum_of(network) != own->sha256)
        throw TemplateError(TemplateProblem::kOtherNetwork, gallery.path(),
                            fmt::format("its templates are {}, not of {}",
                                        !deep             ? "classic"
                                        : network.empty() ? "of the installed network"
                                                          : "of " + named_as(network),
                                        own->name));
      return;  // the same file under another name
    }
    if (!own && !network.empty() && kind != TemplateKind::kClassic)
      throw TemplateError(TemplateProblem::kNetworkNotGiven, gallery.path(),
                          fmt::format("its templates were computed with {}, which is not given",
                                      named_as(network)));
    if (kind == TemplateKind::kDeep && !deep)
      throw TemplateError(TemplateProblem::kNotDeep, gallery.path(),
                          "its templates are classic, and one gallery keeps one kind");
    if (kind == TemplateKind::kClassic && deep)
      throw TemplateError(TemplateProblem::kNotClassic, gallery.path(),
                          "its templates are deep, and one gallery keeps one kind");
    return;
  }
  if (!set_kind) return;
  if (own || kind == TemplateKind::kDeep) {
    use_deep_templates(gallery, own);
    return;
  }
  gallery.set_network("");
  const bool wanted =
      kind == TemplateKind::kDeep || (kind == TemplateKind::kAuto && has_deep_templates(models));
  if (wanted != deep)
    gallery.set_algorithm(wanted ? kDeepAlgorithm
                                 : recognition::name_of(recognition::Algorithm::kDefault));
}

std::optional<recognition::Background> load_background(const ModelStore& models,
                                                       const std::string& which) {
  if (which == kNoBackground) return std::nullopt;
  if (which.empty() && !models.has(kShippedBackground)) {
    log_warning(
        "{}: not found; a gallery of one person cannot distinguish this person from strangers",
        models.expected_path(kShippedBackground));
    return std::nullopt;
  }
  return recognition::read_background(models.path_or(which, kShippedBackground));
}

std::optional<recognition::Background> background_for(people::Gallery& gallery,
                                                      const ModelStore& models,
                                                      const std::string& which,
                                                      const SharedNetwork& own) {
  const std::int64_t faces = gallery.face_count_up_to(people::kMaxSmallGalleryFaces + 1);
  if (has_deep_templates(gallery)) {
    if (faces == 0) return std::nullopt;
    return load_deep_background(models, which, own);
  }
  const bool learned = gallery.model_generation() == gallery.generation();
  if (which.empty() && (faces == 0 || (faces <= people::kMaxSmallGalleryFaces && learned)))
    return std::nullopt;
  return load_background(models, which);
}

people::Gallery open_gallery(const std::string& path) {
  try {
    return people::Gallery(path, DatabaseAccess::kWrite);
  } catch (const OutputError&) {
    return people::Gallery(path, DatabaseAccess::kRead);
  }
}

people::Gallery open_gallery_to_write(const std::string& path) {
  try {
    return people::Gallery(path, DatabaseAccess::kWrite);
  } catch (const DatabaseLockedError&) {
    throw;
  } catch (const OutputError& error) {
    // If reading fails for the same reason, the input is wrong: a missing file, another format.
    try {
      static_cast<void>(people::Gallery(path, DatabaseAccess::kRead));
    } catch (const InputError& wrong) {
      if (std::string_view(wrong.what()) == error.what()) throw;
    }
    throw;
  }
}

std::optional<people::GalleryModel> train_gallery(people::Gallery& gallery,
                                                  const recognition::Background* background,
                                                  people::TrainingPolicy policy, Progress& progress,
                                                  const std::stop_token& stop,
                                                  people::SearchMode search_mode) {
  const auto load = [&](bool store) {
    return people::load_gallery_model(gallery, background, store, policy, progress, stop,
                                      search_mode);
  };
  try {
    try {
      return load(true);
    } catch (const OutputError& error) {
      log_debug("{}", error.what());
    } catch (const InputError& error) {
      log_debug("{}", error.what());
    }
    return load(false);
  } catch (const std::invalid_argument& error) {
    throw InputError(gallery.path(), error.what());
  }
}

nlohmann::ordered_json to_json(const IdentifiedFace& face) {
  const cv::Rect2d& box = face.face.box;
  nlohmann::ordered_json object = {
      {"box",
       {std::lround(box.x), std::lround(box.y), std::lround(box.width), std::lround(box.height)}},
      {"label", face.identity.label.empty() ? nlohmann::ordered_json()
                                            : nlohmann::ordered_json(face.identity.label)},
      {"confidence", std::round(face.identity.confidence * 1e4) / 1e4},
      {"known", face.identity.known},
      {"trusted", face.face.trusted}};
  if (face.face.id > 0) object["id"] = face.face.id;
  return object;
}

void identify_faces(const recognition::Recognizer* model, bool cropped,
                    const IdentificationOptions& options, std::vector<IdentifiedFace>& faces,
                    PooledTemplates& pool) {
  const IdentifyTemplate identify_template = [&](const std::vector<float>& features,
                                                 double false_accepts) {
    return people::recognize(*model, features, false_accepts);
  };
  identify_faces(model, identify_template, cropped, options, faces, pool);
}

void identify_faces(const recognition::Recognizer* model, const IdentifyTemplate& identify_template,
                    bool cropped, const IdentificationOptions& options,
                    std::vector<IdentifiedFace>& faces, PooledTemplates& pool) {
  std::set<int> seen;
  for (IdentifiedFace& face : faces) {
    const bool tracked = face.face.id > 0;
    if (tracked) seen.insert(face.face.id);
    if (model == nullptr) continue;
    std::vector<float> features = recognition::template_of(
        *model, cropped ? face.face.crop
                        : people::recognizer_input(model->options.algorithm, face.face.crop));
    if (tracked) {
      std::vector<std::vector<float>>& latest = pool[face.face.id];
      latest.push_back(std::move(features));
      if (latest.size() > static_cast<std::size_t>(options.max_pooled))
        latest.erase(latest.begin());
      features = recognition::pooled(*model, latest);
    }
    face.identity = identify_template(
        features, (tracked ? kTrackedFalseAcceptShare : 1) * options.false_accepts);
  }
  std::erase_if(pool, [&](const auto& track) { return !seen.contains(track.first); });
}

void IdentifierOptions::check() const {
  TARSIER_REQUIRE(!gallery.empty() || !recognizer.empty(), "neither gallery nor recognizer");
  TARSIER_REQUIRE(!cropped || !recognizer.empty(), "cropped images go with a recognizer");
  TARSIER_REQUIRE(!write_gallery || recognizer.empty(), "write_gallery and a recognizer");
  TARSIER_REQUIRE(!enroll || recognizer.empty(), "enroll and a recognizer");
  TARSIER_REQUIRE(!algorithm || enroll, "an algorithm goes with enroll");
  TARSIER_REQUIRE(!network || templates != TemplateKind::kClassic,
                  "a network goes with deep templates");
  reading.check();
  identification.check();
}

nlohmann::ordered_json to_json(const IdentifierResult& result) {
  nlohmann::ordered_json faces = nlohmann::ordered_json::array();
  for (const IdentifiedFace& face : result.faces) faces.push_back(to_json(face));
  return {{"faces", std::move(faces)}, {"ms", std::round(result.ms * 100) / 100}};
}

// These members refer to each other, so the object must not move.
struct IdentifierState::OpenGallery {
  explicit OpenGallery(people::Gallery opened) : gallery(std::move(opened)) {}
  void update_background();

  people::Gallery gallery;
  // The last one is used. An index or enroller may still refer to an earlier one.
  std::list<recognition::Background> backgrounds;
  std::optional<people::GalleryFollower> follower;
  // Of the gallery as it is now; null: the background was loaded for everything to come.
  std::function<std::optional<recognition::Background>()> load_background;
  std::int64_t generation = -1;                     // when update_background() looked
  std::optional<std::pair<bool, bool>> loaded_for;  // deep, large
};

// Loads the background that the gallery needs since another program enrolled people: the first ones
// with deep templates, or more than a small gallery has.
void IdentifierState::OpenGallery::update_background() {
  if (!load_background) return;
  const std::int64_t now = gallery.generation();
  if (now == generation) return;
  generation = now;
  const std::int64_t faces = gallery.face_count_up_to(people::kMaxSmallGalleryFaces + 1);
  const bool deep = has_deep_templates(gallery);
  const bool large = faces > people::kMaxSmallGalleryFaces;
  if (faces == 0 || (!deep && !large)) return;
  const recognition::Background* current = follower->background();
  if (current != nullptr && (current->network != nullptr) == deep) return;
  const std::pair<bool, bool> kind(deep, large);
  if (std::exchange(loaded_for, kind) == kind) return;
  try {
    if (auto background = load_background()) {
      backgrounds.push_back(std::move(*background));
      follower->use_background(&backgrounds.back());
    }
  } catch (const Error& error) {
    log_warning("{}: new people are not identified: {}", gallery.path(), error.what());
  }
}

IdentifierState::IdentifierState(people::FaceReader reader,
                                 std::shared_ptr<const recognition::Recognizer> model)
    : reader_(std::move(reader)), model_(std::move(model)) {}
IdentifierState::IdentifierState(people::FaceReader reader, people::GalleryFollower& follower)
    : reader_(std::move(reader)), follower_(&follower) {}
IdentifierState::~IdentifierState() = default;
IdentifierState::IdentifierState(IdentifierState&&) noexcept = default;
IdentifierState& IdentifierState::operator=(IdentifierState&&) noexcept = default;

const recognition::Recognizer* IdentifierState::recognizer() const {
  return follower_ != nullptr ? follower_->recognizer() : model_.get();
}

people::Recognition IdentifierState::recognize(const std::vector<float>& features,
                                               double false_accepts) {
  if (follower_ != nullptr) return follower_->recognize(features, false_accepts);
  TARSIER_REQUIRE(model_ != nullptr, "nobody is enrolled");
  return people::recognize(*model_, features, false_accepts);
}

bool IdentifierState::is_enrolled(const std::string& name) const {
  if (follower_ != nullptr) return follower_->is_enrolled(name);
  return model_ != nullptr &&
         std::find(model_->labels.begin(), model_->labels.end(), name) != model_->labels.end();
}

people::Gallery* IdentifierState::gallery() const {
  return follower_ != nullptr ? &follower_->gallery() : nullptr;
}

const recognition::Background* IdentifierState::background() const {
  return follower_ != nullptr ? follower_->background() : nullptr;
}

bool IdentifierState::update() {
  if (follower_ == nullptr) return false;
  if (gallery_) gallery_->update_background();
  const people::GalleryFollower::Change change = follower_->update();
  // Pooled templates may be of another space. And a correction holds from this frame on.
  if (change != people::GalleryFollower::Change::kNone) pool_.clear();
  return change != people::GalleryFollower::Change::kNone;
}

void IdentifierState::replace(std::optional<people::GalleryModel> model) {
  TARSIER_REQUIRE(follower_ != nullptr, "a state without a gallery has no model of one");
  follower_->replace(std::move(model));
  pool_.clear();
}

Identifier::Identifier(const IdentificationOptions& options, bool cropped)
    : identification_(options), cropped_(cropped) {
  identification_.check();
}

Identifier Identifier::load(const ModelStore& models, const IdentifierOptions& options) {
  options.check();
  Identifier identifier(options.identification, options.cropped);
  identifier.models_ = models;
  identifier.options_ = options;
  // A wrong path is reported before anything is written, even if the file is needed only later.
  if (!options.background.empty()) static_cast<void>(load_background(models, options.background));
  if (options.templates == TemplateKind::kDeep)
    static_cast<void>(load_deep_network(models, options.network));
  if (!options.recognizer.empty()) {
    recognition::Recognizer model = recognition::read_recognizer(options.recognizer);
    if (model.options.algorithm == recognition::Algorithm::kDeep)
      attach_network(model, load_deep_network(models, options.network), options.recognizer);
    identifier.model_ = std::make_shared<const recognition::Recognizer>(std::move(model));
  }
  identifier.reader_.emplace(FaceReaderModel::load(models, options.reading));
  return identifier;
}

IdentifierState Identifier::open() const {
  NoProgress quiet;
  return open(quiet, {});
}

IdentifierState Identifier::open(Progress& progress, const std::stop_token& stop) const {
  TARSIER_REQUIRE(reader_.has_value(), "an identifier of names alone opens nothing");
  if (model_ != nullptr) return {reader_->make_reader(), model_};
  auto opened = std::make_unique<IdentifierState::OpenGallery>(
      options_.enroll || options_.write_gallery
          ? people::Gallery(options_.gallery, DatabaseAccess::kCreate)
          : open_gallery(options_.gallery));
  if (options_.algorithm)
    opened->gallery.set_algorithm(recognition::name_of(*options_.algorithm));
  else
    resolve_template_kind(opened->gallery, options_.templates, models_, options_.enroll,
                          options_.network);
  std::optional<recognition::Background> loaded =
      options_.enroll && has_deep_templates(opened->gallery)
          ? load_deep_background(models_, options_.background, options_.network)
      : options_.enroll
          ? load_background(models_, options_.background)
          : background_for(opened->gallery, models_, options_.background, options_.network);
  if (loaded) opened->backgrounds.push_back(std::move(*loaded));
  const recognition::Background* background =
      opened->backgrounds.empty() ? nullptr : &opened->backgrounds.back();
  if (!options_.enroll) {
    opened->load_background = [&gallery = opened->gallery, models = models_,
                               which = options_.background, network = options_.network] {
      return background_for(gallery, models, which, network);
    };
  }
  std::optional<people::GalleryModel> model;
  try {
    model = train_gallery(opened->gallery, background, people::TrainingPolicy::kIfNeeded, progress,
                          stop, people::SearchMode::kIndexed);
  } catch (const InputError& error) {
    if (!options_.enroll) throw;
    log_warning("{}", error.what());  // e.g. Fisherfaces with one person
  }
  opened->follower.emplace(opened->gallery, background, std::move(model),
                           people::SearchMode::kIndexed);
  IdentifierState state(reader_->make_reader(), *opened->follower);
  state.gallery_ = std::move(opened);
  return state;
}

IdentifierResult Identifier::process(const Frame& frame, IdentifierState& state,
                                     DebugSink* debug) const {
  static_cast<void>(state.update());
  const auto start = std::chrono::steady_clock::now();
  IdentifierResult result;
  result.faces = find(frame, state, debug);
  identify(result.faces, state);
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  result.ms = spent.count();
  return result;
}

std::vector<IdentifiedFace> Identifier::find(const Frame& frame, IdentifierState& state,
                                             DebugSink* debug) const {
  const std::string source = source_of(frame);
  if (frame.still || source != state.source_) {
    state.pool_.clear();
    state.reader_.reset();
  }
  state.source_ = source;
  const cv::Mat& gray = gray_of(frame.image, state.gray_);
  std::vector<IdentifiedFace> faces;
  if (cropped_) {
    IdentifiedFace whole;
    whole.face.crop = gray;
    whole.face.box = {0, 0, static_cast<double>(gray.cols), static_cast<double>(gray.rows)};
    faces.push_back(std::move(whole));
  } else {
    for (people::Face& face : frame.still ? state.reader_.read(gray, debug)
                                          : state.reader_.track(gray, frame.time, debug))
      faces.push_back({std::move(face), {}});
  }
  return faces;
}

void Identifier::identify(std::vector<IdentifiedFace>& faces, IdentifierState& state) const {
  const IdentifyTemplate identify_template = [&](const std::vector<float>& features,
                                                 double false_accepts) {
    return state.recognize(features, false_accepts);
  };
  identify_faces(state.recognizer(), identify_template, cropped_, identification_, faces,
                 state.pool_);
}

void Enroller::enroll(const std::string& name, const std::string& note, const people::Face& face,
                      const std::string& source, std::int64_t time) {
  people::StoredFace stored;
  stored.crop = face.crop;
  stored.quality = face.quality.score();
  stored.measures = people::quality_json(face.quality).dump();
  stored.source = source;
  stored.time = time;
  templates_.fill(stored);
  gallery_->enroll(name, note, stored);
}

}  // namespace tarsier::face
