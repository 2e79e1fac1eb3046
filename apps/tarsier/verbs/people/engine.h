// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/face/recognition/evaluation.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include "framework/cli.h"
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags of all verbs that read faces.
struct PeopleFlags {
  std::string gallery = "people.db";
  std::string eyes = "landmarks";
  std::string templates = "auto";  // classic, deep
  std::string background;          // empty: the installed one; "none": no background
  std::string embedding;           // the user's own ONNX file for deep templates; may be empty
  std::string detector_model;      // ONNX file of a face detector; may be empty
  double min_face = 0;             // px, min width of a face; 0: the default
  bool thorough = true;
  std::string rolled = "auto";  // see face::landmarks::RolledSearch
};

void add_gallery_flag(Command& verb, PeopleFlags& flags);
void add_face_flags(Command& verb, PeopleFlags& flags);
// Adds only the flags that select the templates.
void add_template_flags(Command& verb, PeopleFlags& flags);

// The network of --embedding, read once; null if none is given. Throws UsageError, ModelError.
[[nodiscard]] face::SharedNetwork own_network(const PeopleFlags& flags);
// The file of --background. If it is not given and --embedding is, the background file beside the
// embedding, if there is one.
[[nodiscard]] std::string background_of(const PeopleFlags& flags);
// The kind that --template and --embedding select; throws UsageError.
[[nodiscard]] face::TemplateKind template_kind(const PeopleFlags& flags);
// Whether an image without a trusted face yields its most likely face, see
// face::people::FaceReaderOptions::min_uncertain.
enum class UncertainFaces { kExclude, kInclude };
// Throws UsageError for an unknown eye method, ModelError for --detector-model.
[[nodiscard]] face::people::FaceReaderOptions reading_options(const PeopleFlags& flags,
                                                              UncertainFaces uncertain);
// The options of all flags; includes uncertain faces.
[[nodiscard]] face::IdentifierOptions identifier_options(const PeopleFlags& flags);
// Uses the installed models. A signal ends the program while they load. Throws ModelError.
[[nodiscard]] face::Identifier load_identifier(const face::IdentifierOptions& options);
// Uses the installed models. Throws UsageError, ModelError.
[[nodiscard]] face::people::FaceReader make_face_reader(
    const PeopleFlags& flags, UncertainFaces uncertain = UncertainFaces::kExclude);

// face::load_background() for the flag.
[[nodiscard]] std::optional<face::recognition::Background> find_background(
    const PeopleFlags& flags);
// face::load_deep_background() for the flag.
[[nodiscard]] face::recognition::Background find_deep_background(const PeopleFlags& flags);
// The background that new faces of a gallery need. Settles the gallery's templates first.
[[nodiscard]] std::optional<face::recognition::Background> background_to_enroll(
    face::people::Gallery& gallery, const PeopleFlags& flags);
// Path of the background's file; empty for "none".
[[nodiscard]] std::string background_path(const PeopleFlags& flags);

// face::train_gallery().
[[nodiscard]] std::optional<face::people::GalleryModel> load_model(
    face::people::Gallery& gallery, const face::recognition::Background* background,
    Context& context, face::people::TrainingPolicy policy = face::people::TrainingPolicy::kIfNeeded,
    face::people::SearchMode search_mode = face::people::SearchMode::kExhaustive);
// Only the recogniser of the gallery.
[[nodiscard]] std::optional<face::recognition::Recognizer> model_of_gallery(
    face::people::Gallery& gallery, const PeopleFlags& flags, Context& context,
    face::people::TrainingPolicy policy = face::people::TrainingPolicy::kIfNeeded);
// The faces of a list in the recogniser's form; with `raw` whole images. `missed` lists images
// without a face.
struct ListedFaces {
  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;
  std::vector<bool> trusted;        // see face::people::Face
  std::vector<std::string> missed;  // paths
  std::vector<std::string> missed_labels;
};
[[nodiscard]] ListedFaces read_listed_faces(const std::string& list, bool raw, cv::Size size,
                                            bool classical, face::people::FaceReader* reader,
                                            Context& context,
                                            UncertainFaces uncertain = UncertainFaces::kExclude);

// "2024-05-01T12:30:15.250Z"
[[nodiscard]] std::string time_text(std::int64_t ms);
[[nodiscard]] std::int64_t now_ms();
// A stamp with the time now and the user who runs this program.
[[nodiscard]] face::people::CorrectionStamp correction_stamp();

}  // namespace tarsier::cli
