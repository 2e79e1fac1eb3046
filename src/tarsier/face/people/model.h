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

// From a gallery to a recogniser and from a face to a name.
//
// Up to kLearnedWhole faces everything is learned from all of them, again after each change, when
// it is next asked for: seconds. A larger gallery (of the default recogniser, with a background)
// does not learn its directions: faces are kept as coordinates in the fixed directions of the
// background (recognition/background_space.h), made once, when they are enrolled. What is learned
// within these directions is learned from at most recognition::kMaxLearnedFaces faces, when there
// is nothing learned yet or when it is asked for. Enrolling never takes away what is there.
//
// Deep templates are such coordinates in a gallery of any size: the network's numbers of a face, in
// the place of a background's directions. Up to kLearnedWhole faces, what is learned within them is
// learned again after each change, too.
namespace tarsier::face::people {

inline constexpr int kLearnedWhole = 500;
// The classical recognisers compare each image with each: no larger galleries for them.
inline constexpr int kMaxClassical = 1000;

// What a recogniser of this kind gets of a face that cut_face() made: the default and the deep one
// the face as it is, the classical ones classical_face().
[[nodiscard]] cv::Mat recognizer_input(recognition::Algorithm algorithm, const cv::Mat& crop);

class GalleryIndex;  // gallery_index.h

// A recogniser with the gallery's people. With an index the recogniser holds none of them: they are
// looked up in the gallery.
struct GalleryModel {
  recognition::Recognizer recognizer;
  std::vector<std::int64_t> faces;   // id of the face of each template, rising
  std::vector<std::int64_t> people;  // id of the person of each label
  std::int64_t id = 0;               // of the stored model; 0: it is not stored
  std::int64_t space = 0;            // of the stored templates, see StoredModel; 0: not stored
  std::int64_t generation = 0;       // of the gallery that it is the model of
  // Templates of the gallery's negatives, by their id: made once.
  std::map<std::int64_t, std::vector<float>> negatives;
  std::shared_ptr<GalleryIndex> index;  // or null
};

// Which model a gallery needs.
enum class Learn {
  kWhenDue,  // the one that is stored, where it will do
  kNow,      // another one
};

// Whether a large gallery may be searched by its index, where it has one that can be used.
enum class Searching {
  kAll,  // all faces are read and compared
  kByIndex,
  kNothing,  // nobody is: templates are made and what is due is learned, and there is no model
};

// The model of a gallery, in small steps, for callers that do other work meanwhile. Makes
// templates that are missing, learns what is due, stores both as it goes (each some dozens of
// templates for themselves: what was made before an interruption stays). Another program may change
// the gallery meanwhile: see GalleryFollower.
class GalleryTraining {
 public:
  // `background` may be null; both must outlive it. `store` false: the gallery is only read.
  // Throws std::invalid_argument for what the algorithm cannot be trained on (Fisherfaces: one
  // person; classical ones: too many faces).
  GalleryTraining(Gallery& gallery, const recognition::Background* background, bool store,
                  Learn learn, Searching searching = Searching::kAll);
  ~GalleryTraining();
  GalleryTraining(GalleryTraining&&) noexcept;
  GalleryTraining& operator=(GalleryTraining&&) noexcept;
  // Does the next piece; false: all is done. Throws Interrupted, std::invalid_argument.
  bool step(Progress& progress, const std::stop_token& stop);
  [[nodiscard]] double work() const;  // of the last step, as recognition::Training has it
  // Once, after the last step. Nothing for a gallery without faces.
  [[nodiscard]] std::optional<GalleryModel> take();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// All its steps.
[[nodiscard]] std::optional<GalleryModel> load_gallery_model(
    Gallery& gallery, const recognition::Background* background, bool store, Learn learn,
    Progress& progress, const std::stop_token& stop, Searching searching = Searching::kAll);

// The recogniser alone.
[[nodiscard]] std::optional<recognition::Recognizer> gallery_model(
    Gallery& gallery, const recognition::Background* background, bool store, Progress& progress,
    const std::stop_token& stop, Learn learn = Learn::kWhenDue);

// Makes the templates of faces that are going to be enrolled, in the space that the gallery uses,
// so that enrolling changes nothing else. Takes as long for a gallery of any size.
class TemplateMaker {
 public:
  // `background` may be null; both must outlive it.
  TemplateMaker(Gallery& gallery, const recognition::Background* background);
  // Fills `features` and `space` from `crop`; leaves them empty where nothing was learned yet: the
  // template is made when a model is next asked for.
  void fill(StoredFace& face);

 private:
  void look();
  Gallery& gallery_;
  const recognition::Background* background_;
  std::int64_t generation_ = -1;
  std::int64_t coordinates_ = 0;  // their space
  std::int64_t model_ = 0;        // id of `recognizer_`
  bool in_coordinates_ = false;
  std::optional<recognition::Recognizer> recognizer_;
};

struct Recognition;

// Keeps the model of a running program up with its gallery, whichever program changes that. What is
// learned stays what it was until another program has learned and stored something else.
class GalleryFollower {
 public:
  // Both must outlive it; `background` may be null. `model`: nothing where nobody is enrolled.
  GalleryFollower(Gallery& gallery, const recognition::Background* background,
                  std::optional<GalleryModel> model, Searching searching = Searching::kAll);

  enum class Change {
    kNone,
    kFaces,  // faces came or went
    kModel,  // templates are of another space: those of before do not go with them
  };
  // One look-up where nothing changed. Templates of people who were forgotten are gone afterwards,
  // templates of new faces are there as far as they are stored; corrections hold.
  Change update();
  // Another model, learned meanwhile; then update().
  void replace(std::optional<GalleryModel> model);
  [[nodiscard]] const recognition::Recognizer* recognizer() const {
    return model_ ? &model_->recognizer : nullptr;
  }
  [[nodiscard]] Gallery& gallery() const { return gallery_; }
  [[nodiscard]] const recognition::Background* background() const { return background_; }
  // As recognize() below; through the index where there is one. An index that turns out to be
  // damaged is left, with a warning: all faces are read then. Somebody must be enrolled.
  [[nodiscard]] Recognition recognize(const std::vector<float>& features, double false_accepts);
  // Whether somebody of this name is enrolled.
  [[nodiscard]] bool knows(const std::string& name) const;
  [[nodiscard]] const GalleryIndex* index() const { return model_ ? model_->index.get() : nullptr; }

 private:
  [[nodiscard]] bool take_index();
  void read_all();
  void follow_faces();
  Gallery& gallery_;
  const recognition::Background* background_;
  std::optional<GalleryModel> model_;
  Searching searching_;
  std::string tried_index_;  // Gallery::index_record() of one that could not be used
  std::int64_t generation_ = -1;
};

// A face's name, with what it is worth.
struct Recognition {
  std::string label;      // the nearest person; empty: nobody is enrolled
  double score = 0;       // the recogniser's own
  double threshold = 0;   // of the score, at the stated rate of false accepts
  double confidence = 0;  // 0..1
  bool known = false;
  int nearest = -1;  // index of the nearest template; -1 with an index of the gallery, too
};

// `false_accepts`: rate that `known` may be wrong for strangers, (0, 1). Without calibration (one
// person and no background, or classical ones of two) nobody is known. Of the confidence, 0.5 is
// where the score reaches the threshold; it rises with the score as the calibration has it.
[[nodiscard]] Recognition recognize(const recognition::Recognizer& model,
                                    const std::vector<float>& features, double false_accepts);

// The same of a score that is known, among so many people.
[[nodiscard]] Recognition recognition_of(const recognition::Recognizer& model,
                                         const recognition::PersonScore& best, double false_accepts,
                                         int people);

// People of the gallery, other than `name`, whom these new faces (cut_face()) are taken for at a
// false accept rate of one in a thousand by more than half of them: probably the same person under
// another name. Empty where there are none.
[[nodiscard]] std::vector<std::string> other_names(const recognition::Recognizer& model,
                                                   const std::vector<cv::Mat>& crops,
                                                   const std::string& name);
// The same of a gallery, as the follower knows it.
[[nodiscard]] std::vector<std::string> other_names(GalleryFollower& follower,
                                                   const std::vector<cv::Mat>& crops,
                                                   const std::string& name);

}  // namespace tarsier::face::people
