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

// The flags of every verb that looks at faces.
struct PeopleFlags {
  std::string gallery = "people.db";
  std::string eyes = "landmarks";
  std::string templates = "auto";  // classic, deep
  std::string background;          // empty: the one that ships; "none": nothing is known
  std::string embedding;           // ONNX file of the user's own, for deep templates; or empty
  std::string detector_model;      // ONNX file that finds faces; or empty
  double min_face = 0;             // px, smallest face that is looked for; 0: the usual
  bool thorough = true;
  std::string rolled = "auto";  // see face::landmarks::RolledSearch
};

void add_gallery_flag(Command& verb, PeopleFlags& flags);
void add_face_flags(Command& verb, PeopleFlags& flags);
// Those of them that say what faces are compared by.
void add_template_flags(Command& verb, PeopleFlags& flags);

// The network of --embedding, read once; null: none is named. Throws UsageError, ModelError.
[[nodiscard]] face::SharedNetwork own_network(const PeopleFlags& flags);
// --background; of --embedding the file beside it, where there is one and none is named.
[[nodiscard]] std::string background_of(const PeopleFlags& flags);
// What --template, --embedding say together; throws UsageError.
[[nodiscard]] face::TemplateKind template_kind(const PeopleFlags& flags);
// Whether an image without a face that is trusted gives its most likely one, see
// face::people::FaceReaderOptions::min_uncertain.
enum class UncertainFaces { kNone, kToo };
// Throws UsageError for an unknown way to find eyes, ModelError for --detector-model.
[[nodiscard]] face::people::FaceReaderOptions reading_options(const PeopleFlags& flags,
                                                              UncertainFaces uncertain);
// All that the flags say; with uncertain faces.
[[nodiscard]] face::IdentifierOptions identifier_options(const PeopleFlags& flags);
// With the models that ship; a signal ends the program. Throws ModelError.
[[nodiscard]] face::Identifier load_identifier(const face::IdentifierOptions& options);
// With the models that ship. Throws UsageError, ModelError.
[[nodiscard]] face::people::FaceReader make_face_reader(
    const PeopleFlags& flags, UncertainFaces uncertain = UncertainFaces::kNone);

// face::load_background() of the flag.
[[nodiscard]] std::optional<face::recognition::Background> find_background(
    const PeopleFlags& flags);
// face::load_deep_background() of the flag.
[[nodiscard]] face::recognition::Background find_deep_background(const PeopleFlags& flags);
// What new faces of a gallery need: settles its templates first.
[[nodiscard]] std::optional<face::recognition::Background> background_to_enroll(
    face::people::Gallery& gallery, const PeopleFlags& flags);
// Its file; empty for "none".
[[nodiscard]] std::string background_path(const PeopleFlags& flags);

// face::learn_gallery().
[[nodiscard]] std::optional<face::people::GalleryModel> load_model(
    face::people::Gallery& gallery, const face::recognition::Background* background,
    Context& context, face::people::Learn learn = face::people::Learn::kWhenDue,
    face::people::Searching searching = face::people::Searching::kAll);
// The recogniser alone.
[[nodiscard]] std::optional<face::recognition::Recognizer> model_of_gallery(
    face::people::Gallery& gallery, const PeopleFlags& flags, Context& context,
    face::people::Learn learn = face::people::Learn::kWhenDue);
// The faces of a list as a recogniser gets them; `raw`: whole images. Images without a face are
// named in `missed`.
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
                                            UncertainFaces uncertain = UncertainFaces::kNone);

// "2024-05-01T12:30:15.250Z"
[[nodiscard]] std::string time_text(std::int64_t ms);
[[nodiscard]] std::int64_t now_ms();
// Now, by the user who runs this program.
[[nodiscard]] face::people::CorrectionStamp correction_stamp();

}  // namespace tarsier::cli
