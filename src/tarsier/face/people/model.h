// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// The recogniser of a gallery, and the identification of a face.
//
// Up to kMaxSmallGalleryFaces faces, everything is trained on all of them. This takes seconds and
// is repeated on the next use after a change. A larger gallery (of the default recogniser, with a
// background) does not learn directions of its own. Its faces are stored as coordinates in the
// fixed directions of the background (recognition/background_space.h), computed once at enrolment.
// Within these directions, the model is trained on at most recognition::kMaxTrainingFaces faces, if
// there is none yet or on request. Enrolment never invalidates it.
//
// Deep templates are such coordinates in a gallery of any size: embeddings instead of coordinates
// in a background's directions. Up to kMaxSmallGalleryFaces faces, the model is trained again after
// each change, too.
namespace tarsier::face::people {

inline constexpr int kMaxSmallGalleryFaces = 500;
// The classical recognisers compare each image with every other, so larger galleries are refused.
inline constexpr int kMaxClassical = 1000;

// The input of a recogniser for a face from crop_face(): the unchanged face for the default and the
// deep one, classical_face() for the classical ones.
[[nodiscard]] cv::Mat recognizer_input(recognition::Algorithm algorithm, const cv::Mat& crop);

class GalleryIndex;  // gallery_index.h

// A recogniser with the gallery's people. With an index, the recogniser contains no people: they
// are looked up in the gallery.
struct GalleryModel {
  recognition::Recognizer recognizer;
  std::vector<std::int64_t> faces;   // face id of each template, rising
  std::vector<std::int64_t> people;  // person id of each label
  std::int64_t id = 0;               // of the stored model; 0: not stored
  std::int64_t space = 0;            // of the stored templates, see StoredModel; 0: not stored
  std::int64_t generation = 0;       // of the gallery that this model describes
  // Templates of the gallery's negatives, by their id; computed once.
  std::map<std::int64_t, std::vector<float>> negatives;
  std::shared_ptr<GalleryIndex> index;  // or null
};

// Which model is needed.
enum class TrainingPolicy {
  kIfNeeded,  // the stored one, if it is still valid
  kAlways,    // a newly trained one
};

// Whether a large gallery may be searched by its index, if it has a usable one.
enum class SearchMode {
  kExhaustive,  // all faces are read and compared
  kIndexed,
  // no search: templates are computed and training is done if due, but no model is returned
  kNone,
};

// Prepares the model of a gallery in small steps, for callers with other work to do in between.
// Computes missing templates, trains if due, and stores both on the way. Templates are stored in
// batches of some dozens, so that they survive an interruption. Another program may change the
// gallery meanwhile: see GalleryFollower.
class GalleryTraining {
 public:
  // `background` may be null; both must outlive the object. `store` false: the gallery is only
  // read. Throws std::invalid_argument for faces that the algorithm cannot be trained on
  // (Fisherfaces: one person; classical ones: too many faces).
  GalleryTraining(Gallery& gallery, const recognition::Background* background, bool store,
                  TrainingPolicy policy, SearchMode search_mode = SearchMode::kExhaustive);
  ~GalleryTraining();
  GalleryTraining(GalleryTraining&&) noexcept;
  GalleryTraining& operator=(GalleryTraining&&) noexcept;
  // Does the next piece of work; false when all is done. Throws Interrupted, std::invalid_argument.
  bool step(Progress& progress, const std::stop_token& stop);
  [[nodiscard]] double work() const;  // of the last step, as in recognition::Training
  // Returns the model. May be called once, after the last step. Empty for a gallery without faces.
  [[nodiscard]] std::optional<GalleryModel> take();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Does all steps of GalleryTraining.
[[nodiscard]] std::optional<GalleryModel> load_gallery_model(
    Gallery& gallery, const recognition::Background* background, bool store, TrainingPolicy policy,
    Progress& progress, const std::stop_token& stop,
    SearchMode search_mode = SearchMode::kExhaustive);

// The recogniser alone.
[[nodiscard]] std::optional<recognition::Recognizer> gallery_model(
    Gallery& gallery, const recognition::Background* background, bool store, Progress& progress,
    const std::stop_token& stop, TrainingPolicy policy = TrainingPolicy::kIfNeeded);

// Computes the templates of faces before their enrolment, in the space that the gallery uses, so
// that enrolment changes nothing else. The time does not depend on the size of the gallery.
class TemplateExtractor {
 public:
  // `background` may be null; both must outlive the object.
  TemplateExtractor(Gallery& gallery, const recognition::Background* background);
  // Sets `features` and `space` from `crop`. Leaves them empty if there is no model yet: the
  // template is then computed when a model is requested.
  void fill(StoredFace& face);

 private:
  void refresh();
  Gallery& gallery_;
  const recognition::Background* background_;
  std::int64_t generation_ = -1;
  std::int64_t coordinates_ = 0;  // space of the coordinates
  std::int64_t model_ = 0;        // id of `recognizer_`
  bool in_coordinates_ = false;
  std::optional<recognition::Recognizer> recognizer_;
};

struct Recognition;

// Keeps the model of a running program up to date with its gallery, whichever program changes the
// gallery. The trained part does not change until another program has trained and stored a new
// model.
class GalleryFollower {
 public:
  // Both must outlive the object; `background` may be null. `model`: empty if nobody is enrolled.
  GalleryFollower(Gallery& gallery, const recognition::Background* background,
                  std::optional<GalleryModel> model,
                  SearchMode search_mode = SearchMode::kExhaustive);

  enum class Change {
    kNone,
    kFaces,  // faces were added or removed
    // Templates are in another space: earlier templates cannot be compared with them.
    kModel,
  };
  // Costs one look-up if nothing changed. Afterwards, templates of forgotten people are gone,
  // stored templates of new faces are available, and corrections are applied.
  Change update();
  // Replaces the model by one that was trained meanwhile; call update() afterwards.
  void replace(std::optional<GalleryModel> model);
  // Changes the background, for example when the gallery has become large; call update()
  // afterwards. The earlier one must outlive the object, too.
  void use_background(const recognition::Background* background);
  [[nodiscard]] const recognition::Recognizer* recognizer() const {
    return model_ ? &model_->recognizer : nullptr;
  }
  [[nodiscard]] Gallery& gallery() const { return gallery_; }
  [[nodiscard]] const recognition::Background* background() const { return background_; }
  // As recognize() below, through the index if there is one. A damaged index is not used any more:
  // a warning is logged, and all faces are read instead. At least one person must be enrolled.
  [[nodiscard]] Recognition recognize(const std::vector<float>& features, double false_accepts);
  // Whether a person of this name is enrolled.
  [[nodiscard]] bool is_enrolled(const std::string& name) const;
  [[nodiscard]] const GalleryIndex* index() const { return model_ ? model_->index.get() : nullptr; }

 private:
  [[nodiscard]] bool load_index();
  void load_all_faces();
  void update_faces();
  Gallery& gallery_;
  const recognition::Background* background_;
  std::optional<GalleryModel> model_;
  SearchMode search_mode_;
  std::string tried_index_;  // Gallery::index_record() of an index that could not be used
  std::int64_t generation_ = -1;
};

// The identification of a face, with its score and confidence.
struct Recognition {
  std::string label;      // the nearest person; empty: nobody is enrolled
  double score = 0;       // of the recogniser
  double threshold = 0;   // of the score, at the requested false accept rate
  double confidence = 0;  // 0..1
  bool known = false;
  // Index of the nearest template; -1: none, or the gallery is searched by its index.
  int nearest = -1;
};

// `false_accepts`: the rate at which strangers may become `known`, (0, 1). Without calibration (one
// person and no background, or a classical recogniser of two people) nobody is known. The
// confidence is 0.5 where the score equals the threshold, and rises with the score by the
// calibration.
[[nodiscard]] Recognition recognize(const recognition::Recognizer& model,
                                    const std::vector<float>& features, double false_accepts);

// The same for a known score, with this number of enrolled people.
[[nodiscard]] Recognition recognition_of(const recognition::Recognizer& model,
                                         const recognition::PersonScore& best, double false_accepts,
                                         int people);

// Other people of the gallery with whom more than half of these new faces (crop_face()) match at a
// false accept rate of one in a thousand. They are probably the same person under another name.
// Empty if there are none.
[[nodiscard]] std::vector<std::string> duplicate_names(GalleryFollower& follower,
                                                       const std::vector<cv::Mat>& crops,
                                                       const std::string& name);

}  // namespace tarsier::face::people
