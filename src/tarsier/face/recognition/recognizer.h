// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/recognition/calibration.h"
#include "tarsier/face/recognition/lbp.h"
#include "tarsier/face/recognition/normalize.h"
#include "tarsier/face/recognition/subspace.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

// Face recognition: five recognisers with the same functions. Faces are CV_8UC1 crops of any size;
// all crops have the same alignment.
namespace tarsier::face::recognition {

struct DeepNetwork;  // deep.h

enum class Algorithm {
  // Edge directions after light normalisation, whitened by the differences between images of one
  // person.
  kDefault,
  // Eigenfaces: nearest training image in the principal components of the pixels.
  kEigen,
  // Fisherfaces: the same in the linear discriminants of the people.
  kFisher,
  // Histograms of local binary patterns, nearest by chi-square.
  kLbph,
  // Embedding by a deep network (deep.h), whitened and compared as in kDefault.
  kDeep,
};

// "default", "eigen", "fisher", "lbph", "deep".
[[nodiscard]] std::string_view name_of(Algorithm algorithm);
[[nodiscard]] Algorithm parse_algorithm(std::string_view name);  // throws std::invalid_argument
// Whether templates are whitened and compared by the cosine, and a background helps: kDefault,
// kDeep.
[[nodiscard]] constexpr bool is_whitened(Algorithm algorithm) {
  return algorithm == Algorithm::kDefault || algorithm == Algorithm::kDeep;
}

struct RecognizerOptions {
  Algorithm algorithm = Algorithm::kDefault;
  // eigen, fisher, lbph: faces are resized to this size, px; 0 x 0: the size of the first training
  // face.
  cv::Size size{0, 0};
  // Max number of components. 0: all (eigen, fisher), 256 (default).
  int components = 0;
  LbpOptions lbp;
  // Default recogniser only:
  DescriptorOptions descriptor;
  // Training also uses slightly shifted, rotated and scaled copies of the faces: the differences
  // between the copies do not depend on the person. 0 disables it; 1 means 1.5 px of 64 and 3
  // degrees.
  double variants = 1;
  double ridge = 0.3;        // added to the scatter within people, in units of its mean
  double mean_weight = 0.5;  // of a person's mean template, relative to the best single one

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(0, 4096)},
            {"variants", variants, range(0, 4)},
            {"ridge", ridge, above(0, 100)},
            {"mean_weight", mean_weight, range(0, 1)}};
  }
  void check() const;
};

// A trained recogniser with its gallery. A value type: copies are independent. Const functions are
// thread-safe.
struct Recognizer {
  RecognizerOptions options;        // `size` is set
  std::vector<std::string> labels;  // people, in the order of their first face
  // template = components (x - mean); unused by LBPH
  Eigen::RowVectorXf mean;  // d, of pixels or of the descriptor
  Rows components;          // m x d
  // m: variance (eigen), ratio of scatters (fisher), scatter within people before whitening
  // (default)
  Eigen::VectorXd eigenvalues;
  double residual_variance = 1;  // default: the same outside the components, > 0
  Rows templates;                // one per row
  std::vector<int> people;       // of each template, index into labels
  // Templates of faces that are known not to be a given person, one per row, and that person (index
  // into labels). A face is not identified as a person if it is at least as similar to one of that
  // person's negatives as to the person's best template. Not stored in files.
  Rows negatives;
  std::vector<int> negative_people;
  std::optional<Calibration> calibration;  // none: too few data (one person; Fisher: two)
  // kDeep: computes the embedding of a face. Not stored in files: set it after reading one. Without
  // it, functions that take a face throw std::invalid_argument.
  std::shared_ptr<const DeepNetwork> network;
  // kDeep: fingerprint of the network that the recogniser was trained with; 0: unknown (older
  // files).
  std::int64_t network_fingerprint = 0;
  // Derived by refresh(): the weight of each template (template_weights() of features.h; 1 for the
  // classical recognisers), and 1 / length of the weighted sum of each person's templates (0 for
  // zero length).
  std::vector<double> weights;
  std::vector<double> mean_scale;

  void refresh();  // call after changing `templates` or `people`
  [[nodiscard]] int template_length() const;
  void check() const;  // sizes, ranges, finiteness; throws std::invalid_argument
};

// Statistics of faces in general for the default recogniser, from many people who need not be
// enrolled. Galleries of one or two people have too few data without it.
struct Background {
  Eigen::RowVectorXf mean;  // mean descriptor
  // Weight in the mean of the gallery, in people; (0, 1000].
  double weight = 1;
  CalibrationPrior prior{0, 0.15, 0.5, 2};  // of scores between different people
  // How faces differ (background.h). Empty: this is estimated from the gallery alone.
  Rows basis;                    // m x d, orthonormal rows: principal components of the people
  Eigen::VectorXd variance;      // m, of people along each
  double residual_variance = 0;  // mean squared component of people outside the basis
  Eigen::MatrixXd within;        // m x m, scatter between images of one person
  double within_residual_variance = 0;  // mean square of such differences outside the basis
  double within_weight = 1;             // weight, in differences between images; (0, 1e6]
  // kDeep: fingerprint of the network that the numbers above belong to; 0: kDefault.
  std::int64_t network_fingerprint = 0;
  std::shared_ptr<const DeepNetwork> network;  // this network; not stored in files
  void check() const;                          // throws std::invalid_argument
};
[[nodiscard]] Background background_of(std::span<const cv::Mat> faces,
                                       const DescriptorOptions& options);

// `labels[i]` is the person in faces[i]. The default recogniser needs one image of one person.
// Fisherfaces needs two people and two images of one of them. kDeep needs a background with its
// network. `background` (kDefault; with the same descriptor options) may be null; then a gallery of
// one person cannot reject strangers. If there are more than kMaxTrainingFaces (training.h) faces,
// an evenly chosen subset is used for training. Throws std::invalid_argument for faces that cannot
// be trained on, Interrupted. Stages of `progress`: "describing", "training".
[[nodiscard]] Recognizer train(std::span<const cv::Mat> faces, std::span<const std::string> labels,
                               const RecognizerOptions& options, Progress& progress,
                               const std::stop_token& stop, const Background* background = nullptr);

// The template of a face. default, deep: its length is at most 1; it is less for faces that the
// subspace represents badly, and 0 for a flat image.
[[nodiscard]] std::vector<float> template_of(const Recognizer& model, const cv::Mat& face);

// One template for several images of one person (frames of a video): their mean; default, deep:
// scaled to their mean length. At least one template is needed.
[[nodiscard]] std::vector<float> pooled(const Recognizer& model,
                                        std::span<const std::vector<float>> templates);

// A greater score means more similar. default, deep: cosine, -1..1 (of whitened faces, in all
// directions). Others: minus the distance (Euclidean in the subspace; chi-square), at most 0.
[[nodiscard]] double compare(const Recognizer& model, std::span<const float> a,
                             std::span<const float> b);

struct PersonScore {
  int person = 0;    // index into labels
  double score = 0;  // of the best template; default: combined with that of the mean template
  int nearest = 0;   // index into templates, of this person
};
// Everyone who has a template and is not excluded by a negative, best first; equal scores by rising
// index.
[[nodiscard]] std::vector<PersonScore> identify(const Recognizer& model, const cv::Mat& face);
[[nodiscard]] std::vector<PersonScore> identify_template(const Recognizer& model,
                                                         std::span<const float> probe);
// The first one, without sorting the others.
[[nodiscard]] std::optional<PersonScore> best_person(const Recognizer& model,
                                                     std::span<const float> probe);

// Enrols a face without training the subspace again. Returns the index of the template.
int add_face(Recognizer& model, const cv::Mat& face, const std::string& label);
// Removes the person's templates and name. Returns whether the person existed. The subspace and the
// calibration still depend on the images: train again to forget the person completely.
bool remove_person(Recognizer& model, const std::string& label);

// Inspection of eigen and fisher models.
[[nodiscard]] cv::Mat mean_face(const Recognizer& model);  // CV_8UC1
// CV_8UC1, contrast stretched.
[[nodiscard]] cv::Mat component_image(const Recognizer& model, int i);
// The least-squares reconstruction of a face in the subspace, CV_8UC1 of the model's size.
[[nodiscard]] cv::Mat reconstruction(const Recognizer& model, const cv::Mat& face);
// sqrt(sum of squared grey differences) / pixels, the classical measure; small means similar.
[[nodiscard]] double reconstruction_error(const Recognizer& model, const cv::Mat& face);

// Files of type "face-recognizer". Throws ModelError(path), OutputError.
void write_recognizer(const std::string& path, const Recognizer& model,
                      const nlohmann::json& provenance);
[[nodiscard]] Recognizer read_recognizer(const std::string& path);
// The same as text, for databases. The second throws ModelError(path) for damaged text.
[[nodiscard]] std::string recognizer_text(const Recognizer& model);
[[nodiscard]] Recognizer recognizer_from_text(std::string_view text, const std::string& path);

}  // namespace tarsier::face::recognition
