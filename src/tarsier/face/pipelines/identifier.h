// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/pipelines/detector_model.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"

#include <opencv2/core/mat.hpp>

#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::face {

// --- from images to aligned faces ---

// The models of a people::FaceReader, read once and shared. A reader has state and belongs to one
// thread. This class is const and makes any number of readers.
class FaceReaderModel {
 public:
  // If landmarks68.json or face-detector.json is missing in the store, cascades are used, with a
  // warning. Throws ModelError (broken file), std::invalid_argument (options).
  [[nodiscard]] static FaceReaderModel load(const ModelStore& models,
                                            people::FaceReaderOptions options = {});
  // Throws ModelError if cascades are missing (Debian: opencv-data).
  [[nodiscard]] people::FaceReader make_reader() const;

 private:
  FaceReaderModel(people::FaceReaderOptions options, DetectorModel detector)
      : options_(std::move(options)), detector_(std::move(detector)) {}
  people::FaceReaderOptions options_;
  DetectorModel detector_;
  std::shared_ptr<const landmarks::LandmarkModel> landmarks_;
};

// --- galleries ---

// What the templates of a gallery are made from.
enum class TemplateKind {
  // A gallery with faces keeps its kind. A new gallery gets deep templates if they are installed.
  kAuto,
  kClassic,  // gradient directions, or the input of the classical recognisers
  kDeep,     // output of a deep network (recognition/deep.h)
};
[[nodiscard]] TemplateKind parse_template_kind(
    std::string_view name);  // throws std::invalid_argument
// Whether the store has the network of deep templates, face-embedding.json.
[[nodiscard]] bool has_deep_templates(const ModelStore& models);
// The network of deep templates, and its background: `which`, or people-deep.json of the store.
// `own`, which may be null, is the user's own network (face/onnx) that replaces the installed one;
// then `which` must name its background. Throws ModelError, which says how to get what is missing.
using SharedNetwork = std::shared_ptr<const recognition::DeepNetwork>;
[[nodiscard]] SharedNetwork load_deep_network(const ModelStore& models,
                                              const SharedNetwork& own = nullptr);
[[nodiscard]] recognition::Background load_deep_background(const ModelStore& models,
                                                           const std::string& which = {},
                                                           const SharedNetwork& own = nullptr);
// Gives the recogniser of the file `path` its network. Throws ModelError if the recogniser was
// trained with another network.
void attach_network(recognition::Recognizer& model, SharedNetwork network, const std::string& path);
[[nodiscard]] bool has_deep_templates(people::Gallery& gallery);
// A gallery keeps templates of one kind and one network. Throws InputError if a gallery with faces
// has another kind or network than requested; a gallery made with the user's own network needs the
// same network. With `set_kind`, the kind of a gallery without faces is set.
void resolve_template_kind(people::Gallery& gallery, TemplateKind kind, const ModelStore& models,
                           bool set_kind, const SharedNetwork& own = nullptr);
// From now on the gallery uses deep templates of `own` or of the installed network. Other templates
// are computed again from the crops when a model is next requested.
void use_deep_templates(people::Gallery& gallery, const SharedNetwork& own);

// The background: a model of the variation between faces in general. `which` is a file or "none"
// (no background). If it is empty, the background is people-background.json of the store; if that
// is missing, there is none, with a warning. Throws ModelError.
[[nodiscard]] std::optional<recognition::Background> load_background(const ModelStore& models,
                                                                     const std::string& which = {});
// The background, if a model of the gallery needs it: nothing is learned yet, the gallery changed,
// or it is large. Deep templates always need their background. A file named by `which` is always
// read, so that a wrong file is reported.
[[nodiscard]] std::optional<recognition::Background> background_for(
    people::Gallery& gallery, const ModelStore& models, const std::string& which = {},
    const SharedNetwork& own = nullptr);
// Opens the gallery for writing if possible, else read-only. Throws InputError.
[[nodiscard]] people::Gallery open_gallery(const std::string& path);
// Opens the gallery for writing. Throws InputError if there is no gallery, OutputError if it cannot
// be written.
[[nodiscard]] people::Gallery open_gallery_to_write(const std::string& path);
// The model of a gallery; pending learning is done. A read-only gallery is used as it is. Returns
// nothing for an empty gallery. `background` may be null. Throws InputError if its recogniser
// cannot be trained on this gallery, Interrupted.
[[nodiscard]] std::optional<people::GalleryModel> train_gallery(
    people::Gallery& gallery, const recognition::Background* background,
    people::TrainingPolicy policy, Progress& progress, const std::stop_token& stop,
    people::SearchMode search_mode = people::SearchMode::kExhaustive);

// --- names ---

struct IdentificationOptions {
  double false_accepts = 0.01;  // false accept rate of strangers
  int max_pooled = 10;          // max number of latest templates pooled for a tracked face

  [[nodiscard]] OptionFields fields() {
    return {{"false_accepts", false_accepts, inside(0, 1), "--far",
             "false accept rate that sets the threshold"},
            {"max_pooled", max_pooled, range(1, 1000)}};
  }
  void check() const { check_fields(*this); }
};

// A tracked face has a chance of a false accept in each frame. So each frame gets this share of the
// stated false accept rate.
inline constexpr double kTrackedFalseAcceptShare = 0.1;

struct IdentifiedFace {
  people::Face face;
  people::Recognition identity;
};

// {"box": [x, y, w, h], "label": the nearest person or null, "confidence", "known", "trusted": see
// people::Face}, and "id" for a tracked face.
[[nodiscard]] nlohmann::ordered_json to_json(const IdentifiedFace& face);

// Latest templates of tracked faces, keyed by the face's id.
using PooledTemplates = std::map<int, std::vector<std::vector<float>>>;

// Identifies faces by their templates. For tracked faces (id > 0) the templates of the last frames
// are pooled. Templates of faces that are gone are dropped. `cropped`: the crops are already in the
// recogniser's form. `model` may be null; then no face is identified.
void identify_faces(const recognition::Recognizer* model, bool cropped,
                    const IdentificationOptions& options, std::vector<IdentifiedFace>& faces,
                    PooledTemplates& pool);
// The same with a caller's function that returns the nearest person. `false_accepts` is the false
// accept rate that it must keep.
using IdentifyTemplate =
    std::function<people::Recognition(const std::vector<float>& features, double false_accepts)>;
void identify_faces(const recognition::Recognizer* model, const IdentifyTemplate& identify_template,
                    bool cropped, const IdentificationOptions& options,
                    std::vector<IdentifiedFace>& faces, PooledTemplates& pool);

// --- the pipeline ---

struct IdentifierOptions {
  std::string gallery = "people.db";  // file of the enrolled people
  bool write_gallery = false;         // it must be writable, and is created if it is missing
  // For enrolment. A missing gallery is created, and the background is always loaded. If nothing
  // can be learned yet, that is a warning.
  bool enroll = false;
  std::optional<recognition::Algorithm> algorithm;  // of the gallery from now on; with `enroll`
  // See resolve_template_kind(); ignored with `algorithm`.
  TemplateKind templates = TemplateKind::kAuto;
  SharedNetwork network;   // the user's own, for deep templates; may be null
  std::string recognizer;  // file of `people train -o`, replaces the gallery; empty: none
  std::string background;  // see load_background()
  people::FaceReaderOptions reading;
  bool cropped = false;  // images are cropped faces already; with `recognizer`
  IdentificationOptions identification;
  void check() const;  // throws std::invalid_argument that names the value
};

// The faces of one frame.
struct IdentifierResult {
  std::vector<IdentifiedFace> faces;
  double ms = 0;  // time of process(), milliseconds
};

// {"faces": [to_json(IdentifiedFace)..], "ms"}
[[nodiscard]] nlohmann::ordered_json to_json(const IdentifierResult& result);

// The enrolled people, and what earlier frames of a video contribute. Each stream of frames has its
// own state, used by one thread.
class IdentifierState {
 public:
  // The people of a recogniser; null: nobody.
  IdentifierState(people::FaceReader reader, std::shared_ptr<const recognition::Recognizer> model);
  // The people of a gallery, updated as it changes. The follower must outlive the state.
  IdentifierState(people::FaceReader reader, people::GalleryFollower& follower);
  ~IdentifierState();
  IdentifierState(IdentifierState&&) noexcept;
  IdentifierState& operator=(IdentifierState&&) noexcept;

  // Null if nobody is enrolled. If the gallery is searched by its index, the recogniser has no
  // people and only computes templates.
  [[nodiscard]] const recognition::Recognizer* recognizer() const;
  // The person of a template. Somebody must be enrolled.
  [[nodiscard]] people::Recognition recognize(const std::vector<float>& features,
                                              double false_accepts);
  // Whether a person of this name is enrolled.
  [[nodiscard]] bool is_enrolled(const std::string& name) const;
  // Null if the people come from a recogniser.
  [[nodiscard]] people::Gallery* gallery() const;
  // May be null, see background_for().
  [[nodiscard]] const recognition::Background* background() const;
  // The reader that finds the faces.
  [[nodiscard]] const people::FaceReader& reader() const { return reader_; }
  // Checks whether another program changed the gallery. Processing a frame does this too.
  bool update();
  // Drops the pooled templates of earlier frames, e.g. after a correction.
  void clear_pooled_templates() { pool_.clear(); }
  // Replaces the gallery's model by one learned meanwhile; empty if nobody is enrolled any more.
  // Throws std::invalid_argument for a state without a gallery.
  void replace(std::optional<people::GalleryModel> model);

 private:
  friend class Identifier;
  struct OpenGallery;
  people::FaceReader reader_;
  std::shared_ptr<const recognition::Recognizer> model_;
  std::unique_ptr<OpenGallery> gallery_;
  people::GalleryFollower* follower_ = nullptr;
  PooledTemplates pool_;
  std::string source_;
  cv::Mat gray_;
};

// Identifies the faces of images and videos by a gallery:
//
//   const auto identifier = face::Identifier::load(ModelStore::find());  // people.db
//   face::IdentifierState state = identifier.open();
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const face::IdentifiedFace& face : identifier.process(*frame, state).faces)
//       fmt::print("{}\n", face.identity.known ? face.identity.label : "unknown");
//
// Changes by other programs hold from the next frame on. The class is const: copies share the
// models, and any number of threads may use it, each with its own state.
class Identifier {
 public:
  // Throws ModelError, std::invalid_argument (options).
  [[nodiscard]] static Identifier load(const ModelStore& models,
                                       const IdentifierOptions& options = {});
  // Only identifies faces; states are made by the caller.
  explicit Identifier(const IdentificationOptions& options, bool cropped = false);

  // Opens the gallery and does its pending learning. Throws InputError, OutputError
  // (write_gallery), ModelError (the background), Interrupted; std::invalid_argument for an object
  // made by the public constructor.
  [[nodiscard]] IdentifierState open() const;
  [[nodiscard]] IdentifierState open(Progress& progress, const std::stop_token& stop) const;

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. Faces of still images are independent. Faces of a
  // video are tracked until another source begins. `debug`, which may be null, receives the stages
  // of the largest face.
  [[nodiscard]] IdentifierResult process(const Frame& frame, IdentifierState& state,
                                         DebugSink* debug = nullptr) const;

  // The two halves of process(), for callers that need the faces before anybody is enrolled: find()
  // returns the faces of a frame without names, identify() names them.
  [[nodiscard]] std::vector<IdentifiedFace> find(const Frame& frame, IdentifierState& state,
                                                 DebugSink* debug = nullptr) const;
  void identify(std::vector<IdentifiedFace>& faces, IdentifierState& state) const;

 private:
  IdentificationOptions identification_;
  bool cropped_ = false;
  ModelStore models_;
  IdentifierOptions options_;
  std::optional<FaceReaderModel> reader_;
  std::shared_ptr<const recognition::Recognizer> model_;
};

// --- enrolment ---

// Puts faces into a gallery. Each face is safe on the disk before the next, so a crash loses
// nothing.
class Enroller {
 public:
  // `background` may be null; both arguments must outlive this object.
  Enroller(people::Gallery& gallery, const recognition::Background* background)
      : gallery_(&gallery), templates_(gallery, background) {}
  // Adds a face of `name`. A missing person is added, with `note` as the note of consent. `source`:
  // file or camera. `time`: ms since 1970-01-01 UTC. Throws OutputError, UsageError (the name).
  void enroll(const std::string& name, const std::string& note, const people::Face& face,
              const std::string& source, std::int64_t time);

 private:
  people::Gallery* gallery_;
  people::TemplateExtractor templates_;
};

}  // namespace tarsier::face
