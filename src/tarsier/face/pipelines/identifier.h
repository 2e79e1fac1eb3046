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

// The models of a people::FaceReader, read once and shared: a reader has state and belongs to one
// thread, this is const and makes as many of them as are needed.
class FaceReaderModel {
 public:
  // Where landmarks68.json or face-detector.json of the store is missing cascades do, with a
  // warning. Throws ModelError (broken), std::invalid_argument (options).
  [[nodiscard]] static FaceReaderModel load(const ModelStore& models,
                                            people::FaceReaderOptions options = {});
  // Throws ModelError where cascades are missing (Debian: opencv-data).
  [[nodiscard]] people::FaceReader make_reader() const;

 private:
  FaceReaderModel(people::FaceReaderOptions options, DetectorModel detector)
      : options_(std::move(options)), detector_(std::move(detector)) {}
  people::FaceReaderOptions options_;
  DetectorModel detector_;
  std::shared_ptr<const landmarks::LandmarkModel> landmarks_;
};

// --- galleries ---

// What the templates of a gallery are made of.
enum class TemplateKind {
  kAuto,     // of a gallery with faces: what it has; of a new one: deep where that is installed
  kClassic,  // gradients' directions, or what the classical recognisers use
  kDeep,     // the numbers of a deep network (recognition/deep.h)
};
[[nodiscard]] TemplateKind parse_template_kind(
    std::string_view name);  // throws std::invalid_argument
// Whether the network of deep templates is there: face-embedding.json of the store.
[[nodiscard]] bool has_deep_templates(const ModelStore& models);
// It, and its background: `which` or people-deep.json of the store. Throws ModelError, which says
// how to get what is missing.
// `own`, which may be null, is a network of the user's own (face/onnx) in its place; its background
// must be named.
using SharedNetwork = std::shared_ptr<const recognition::DeepNetwork>;
[[nodiscard]] SharedNetwork load_deep_network(const ModelStore& models,
                                              const SharedNetwork& own = nullptr);
[[nodiscard]] recognition::Background load_deep_background(const ModelStore& models,
                                                           const std::string& which = {},
                                                           const SharedNetwork& own = nullptr);
// Gives a recogniser of a file (`path`) its network. Throws ModelError where it was trained with
// another one.
void attach_network(recognition::Recognizer& model, SharedNetwork network, const std::string& path);
[[nodiscard]] bool has_deep_templates(people::Gallery& gallery);
// A gallery keeps templates of one kind and of one network. Throws InputError where `kind` or the
// network is another than it has and there are faces: a gallery that was made with a network of the
// user's own needs this one. With `choose` the kind of one without faces is set.
void settle_templates(people::Gallery& gallery, TemplateKind kind, const ModelStore& models,
                      bool choose, const SharedNetwork& own = nullptr);
// Deep templates from now on: of `own`, or of the installed network. Others are made again from the
// crops when a model is next asked for.
void choose_deep_templates(people::Gallery& gallery, const SharedNetwork& own);

// What is known of faces in general. `which`: a file; "none": nothing; empty:
// people-background.json of the store, and nothing, with a warning, where that is missing. Throws
// ModelError.
[[nodiscard]] std::optional<recognition::Background> load_background(const ModelStore& models,
                                                                     const std::string& which = {});
// The same where a model of the gallery needs it: nothing is learned yet, or it changed, or it is
// a large one. A file that is named is read in any case: it must be right. Deep templates always
// need theirs.
[[nodiscard]] std::optional<recognition::Background> background_for(
    people::Gallery& gallery, const ModelStore& models, const std::string& which = {},
    const SharedNetwork& own = nullptr);
// Opened to be written where it can be, else to be read. Throws InputError.
[[nodiscard]] people::Gallery open_gallery(const std::string& path);
// The model of a gallery; what is due is learned. A gallery that cannot be written is still used.
// Nothing for an empty one. `background` may be null. Throws InputError for a gallery that its
// recogniser cannot be trained on, Interrupted.
[[nodiscard]] std::optional<people::GalleryModel> learn_gallery(
    people::Gallery& gallery, const recognition::Background* background, people::Learn learn,
    Progress& progress, const std::stop_token& stop,
    people::Searching searching = people::Searching::kAll);

// --- names ---

struct NamingOptions {
  double false_accepts = 0.01;  // rate at which strangers may be taken for somebody
  int max_pooled = 10;          // of a tracked face so many last frames count together

  [[nodiscard]] OptionFields fields() {
    return {{"false_accepts", false_accepts, inside(0, 1), "--far",
             "false accept rate that sets the threshold"},
            {"max_pooled", max_pooled, range(1, 1000)}};
  }
  void check() const { check_fields(*this); }
};

// A face that is tracked has many chances to be taken for somebody: in each frame it gets this
// share of the stated rate of false accepts.
inline constexpr double kTrackedShare = 0.1;

struct NamedFace {
  people::Face face;
  people::Recognition name;
};

// {"box": [x, y, w, h], "label": the nearest person or null, "confidence", "known", "trusted": see
// people::Face}, and the "id" of a tracked face.
[[nodiscard]] nlohmann::ordered_json to_json(const NamedFace& face);

// Latest templates of tracked faces, by the face's id.
using PooledTemplates = std::map<int, std::vector<std::vector<float>>>;

// Names faces by what they look like; of tracked ones (id > 0) the templates of the last frames are
// pooled, and those of faces that are no longer there are forgotten. `cropped`: the crops are as
// the recogniser takes them. `model` may be null: nobody is named.
void name_faces(const recognition::Recognizer* model, bool cropped, const NamingOptions& options,
                std::vector<NamedFace>& faces, PooledTemplates& pool);
// The same where somebody else says who is nearest: at most so many strangers may be taken for
// somebody.
using NameOfTemplate =
    std::function<people::Recognition(const std::vector<float>& features, double false_accepts)>;
void name_faces(const recognition::Recognizer* model, const NameOfTemplate& name, bool cropped,
                const NamingOptions& options, std::vector<NamedFace>& faces, PooledTemplates& pool);

// --- the pipeline ---

struct IdentifierOptions {
  std::string gallery = "people.db";  // file of the people who are enrolled
  bool write_gallery = false;         // it must be writable, and is made where it is missing
  // People are added: a gallery that is missing is made, the background is loaded in any case, and
  // that nothing can be learned yet is a warning.
  bool enroll = false;
  std::optional<recognition::Algorithm> algorithm;  // of the gallery from now on; with `enroll`
  TemplateKind templates = TemplateKind::kAuto;     // see settle_templates(); without `algorithm`
  SharedNetwork network;   // of the user's own, for deep templates; or null
  std::string recognizer;  // file of `people train -o`, in place of the gallery; empty: none
  std::string background;  // see load_background()
  people::FaceReaderOptions reading;
  bool cropped = false;  // images are cut faces already; with `recognizer`
  NamingOptions naming;
  void check() const;  // throws std::invalid_argument that names the value
};

// The faces of one frame.
struct IdentifierResult {
  std::vector<NamedFace> faces;
  double ms = 0;  // spent in process(), milliseconds
};

// {"faces": [to_json(NamedFace)..], "ms"}
[[nodiscard]] nlohmann::ordered_json to_json(const IdentifierResult& result);

// Who is known, and what is known from earlier frames of a video: one for each stream of frames,
// used by one thread.
class IdentifierState {
 public:
  // Those of a recogniser; null: nobody.
  IdentifierState(people::FaceReader reader, std::shared_ptr<const recognition::Recognizer> model);
  // Those of a gallery, as it changes. The follower must outlive the state.
  IdentifierState(people::FaceReader reader, people::GalleryFollower& follower);
  ~IdentifierState();
  IdentifierState(IdentifierState&&) noexcept;
  IdentifierState& operator=(IdentifierState&&) noexcept;

  // Null where nobody is enrolled. Of a gallery that is searched by its index it holds nobody: what
  // makes templates, alone.
  [[nodiscard]] const recognition::Recognizer* recognizer() const;
  // Whose template this is; somebody must be enrolled.
  [[nodiscard]] people::Recognition recognize(const std::vector<float>& features,
                                              double false_accepts);
  // Whether somebody of this name is enrolled.
  [[nodiscard]] bool knows(const std::string& name) const;
  // Null for the people of a recogniser.
  [[nodiscard]] people::Gallery* gallery() const;
  // What is known of faces in general; null where nothing is, see background_for().
  [[nodiscard]] const recognition::Background* background() const;
  // What finds the faces.
  [[nodiscard]] const people::FaceReader& reader() const { return reader_; }
  // Looks whether another program changed the gallery. Frames do it by themselves.
  bool follow();
  // Names from now on come from the frames that follow alone: after a correction.
  void forget_frames() { pool_.clear(); }
  // Another model of the gallery, learned meanwhile; nothing where nobody is enrolled any more.
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

// Names the faces of images and videos after the people of a gallery:
//
//   const auto identifier = face::Identifier::load(ModelStore::find());  // people.db
//   face::IdentifierState state = identifier.open();
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const face::NamedFace& face : identifier.process(*frame, state).faces)
//       fmt::print("{}\n", face.name.known ? face.name.label : "unknown");
//
// What other programs enrol and forget is known from the next frame on. Const: copies share the
// models, and any number of threads may use it, each with a state of its own.
class Identifier {
 public:
  // Throws ModelError, std::invalid_argument (options).
  [[nodiscard]] static Identifier load(const ModelStore& models,
                                       const IdentifierOptions& options = {});
  // Names alone, for states that are made by hand.
  explicit Identifier(const NamingOptions& naming, bool cropped = false);

  // Opens the gallery, and learns what is due. Throws InputError, OutputError (write_gallery),
  // ModelError (the background), Interrupted; std::invalid_argument for one that was made of names
  // alone.
  [[nodiscard]] IdentifierState open() const;
  [[nodiscard]] IdentifierState open(Progress& progress, const std::stop_token& stop) const;

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. Faces of a still stand for themselves; those of a
  // video are tracked until another source begins. `debug`, which may be null, takes the stages of
  // the largest face.
  [[nodiscard]] IdentifierResult process(const Frame& frame, IdentifierState& state,
                                         DebugSink* debug = nullptr) const;

  // Its two halves, for callers that look at faces before anybody is known: the faces of a frame,
  // without names, and their names by what is known now.
  [[nodiscard]] std::vector<NamedFace> find(const Frame& frame, IdentifierState& state,
                                            DebugSink* debug = nullptr) const;
  void name(std::vector<NamedFace>& faces, IdentifierState& state) const;

 private:
  NamingOptions naming_;
  bool cropped_ = false;
  ModelStore models_;
  IdentifierOptions options_;
  std::optional<FaceReaderModel> reader_;
  std::shared_ptr<const recognition::Recognizer> model_;
};

// --- enrolment ---

// Puts faces into a gallery, each safe on the disk before the next: a crash loses nothing.
class Enroller {
 public:
  // `background` may be null; both must outlive it.
  Enroller(people::Gallery& gallery, const recognition::Background* background)
      : gallery_(&gallery), templates_(gallery, background) {}
  // A face of `name`, who is added where there is no such person; `note` of consent is then theirs.
  // `source`: file or camera; `time`: ms since 1970-01-01 UTC. Throws OutputError, UsageError (the
  // name).
  void enroll(const std::string& name, const std::string& note, const people::Face& face,
              const std::string& source, std::int64_t time);

 private:
  people::Gallery* gallery_;
  people::TemplateMaker templates_;
};

}  // namespace tarsier::face
