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

// Who a face is: five recognisers behind one set of functions. Faces are CV_8UC1 crops of any size,
// all cut alike.
namespace tarsier::face::recognition {

struct DeepNetwork;  // deep.h

enum class Algorithm {
  kDefault,  // edge directions in normalised light, whitened by how images of one person differ
  kEigen,    // Eigenfaces: nearest training image in the principal components of the pixels
  kFisher,   // Fisherfaces: the same in the linear discriminants of the people
  kLbph,     // histograms of local binary patterns, nearest by chi-square
  kDeep,     // what a deep network makes of the face (deep.h), whitened and compared as kDefault
};

// "default", "eigen", "fisher", "lbph", "deep".
[[nodiscard]] std::string_view name_of(Algorithm algorithm);
[[nodiscard]] Algorithm parse_algorithm(std::string_view name);  // throws std::invalid_argument
// Whether templates are whitened and compared by the cosine, and a background helps: kDefault, kDeep.
[[nodiscard]] constexpr bool is_whitened(Algorithm algorithm) {
  return algorithm == Algorithm::kDefault || algorithm == Algorithm::kDeep;
}

struct RecognizerOptions {
  Algorithm algorithm = Algorithm::kDefault;
  // eigen, fisher, lbph: px that faces are resized to; 0 x 0: the size of the first training face.
  cv::Size size{0, 0};
  int components = 0;  // at most, eigen and fisher 0: all; default 0: 256
  LbpOptions lbp;
  // Of the default recogniser:
  DescriptorOptions descriptor;
  // Training faces also count slightly shifted, turned and scaled: what differs between those is
  // not the person. 0: no; else how far, 1 is 1.5 px of 64 and 3 degrees.
  double variants = 1;
  double ridge = 0.3;        // added to the scatter within people, in units of its mean
  double mean_weight = 0.5;  // of a person's mean template against the best single one

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(0, 4096)},
            {"variants", variants, range(0, 4)},
            {"ridge", ridge, above(0, 100)},
            {"mean_weight", mean_weight, range(0, 1)}};
  }
  void check() const;
};

// A trained recogniser with its gallery. A value: copies are independent. Const functions may be
// called by any number of threads.
struct Recognizer {
  RecognizerOptions options;        // `size` is filled in
  std::vector<std::string> labels;  // people, in the order of their first face
  // template = components (x - mean); none with LBPH
  Eigen::RowVectorXf mean;  // d, pixels or descriptor
  Rows components;          // m x d
  // m: variance (eigen), ratio of scatters (fisher), scatter within people before whitening
  // (default)
  Eigen::VectorXd importance;
  double rest = 1;          // default: the same of what lies outside the components, > 0
  Rows templates;           // one a row
  std::vector<int> people;  // of each template, index into labels
  // Templates of faces that are not of a person, one a row, and who that is not (index into
  // labels): a face that is at least as much like one of them as like the person's best template
  // is not of this person. No part of files.
  Rows negatives;
  std::vector<int> negative_people;
  std::optional<Calibration> calibration;  // none: too little was known (one person; Fisher, two)
  // kDeep: makes the numbers of a face. It is no part of files: whoever reads one puts it here.
  // Functions that take a face throw std::invalid_argument without it.
  std::shared_ptr<const DeepNetwork> network;
  // kDeep: fingerprint of the network that it was trained with; 0: not known (older files).
  std::int64_t of_network = 0;
  // Derived, see refresh(): what each template counts for (template_weights() of features.h; the
  // classical recognisers: 1), and 1 / length of the weighted sum of each person's templates (0: of
  // no length).
  std::vector<double> weights;
  std::vector<double> mean_scale;

  void refresh();  // after changes of `templates` and `people` by hand
  [[nodiscard]] int template_length() const;
  void check() const;  // sizes, ranges, finiteness; throws std::invalid_argument
};

// What faces in general look like to the default recogniser, from many people who need not be
// enrolled: without it a gallery of one or two people has to guess what is special about them.
struct Background {
  Eigen::RowVectorXf mean;  // mean descriptor
  double weight = 1;        // counts as so many people in the mean of the gallery, (0, 1000]
  CalibrationPrior prior{0, 0.15, 0.5, 2};  // of scores between different people
  // How faces differ (background.h); or empty: the gallery alone tells.
  Rows basis;                // m x d, orthonormal rows: principal components of the people
  Eigen::VectorXd variance;  // m, of people along each
  double outside = 0;        // mean square of what people have outside the basis
  Eigen::MatrixXd within;    // m x m, scatter between images of one person
  double within_rest = 0;    // mean square of such differences outside the basis
  double within_weight = 1;  // counts as so many differences between images, (0, 1e6]
  // Of kDeep: the numbers above are those of the network of this fingerprint; 0: of kDefault.
  std::int64_t of_network = 0;
  std::shared_ptr<const DeepNetwork> network;  // this one; no part of files
  void check() const;                          // throws std::invalid_argument
};
[[nodiscard]] Background background_of(std::span<const cv::Mat> faces,
                                       const DescriptorOptions& options);

// `labels[i]` is who faces[i] shows. The default recogniser works from one image of one person;
// Fisherfaces needs two people and two images of one of them, kDeep a
// background with its network. Throws std::invalid_argument for
// what cannot be trained on and Interrupted. `background` (default recogniser; of the same
// descriptor options) may be null; with one person alone there is then no telling from strangers.
// Of more than kMaxLearnedFaces (training.h) faces an even choice is learned from.
// Stages of `progress`: "describing", "training".
[[nodiscard]] Recognizer train(std::span<const cv::Mat> faces, std::span<const std::string> labels,
                               const RecognizerOptions& options, Progress& progress,
                               const std::stop_token& stop, const Background* background = nullptr);

// What a face is compared by. default, deep: length at most 1, less for what the subspace holds less of,
// 0 for a flat image.
[[nodiscard]] std::vector<float> template_of(const Recognizer& model, const cv::Mat& face);

// One template for several images of one person (frames of a video): their mean;
// default, deep: at their mean length. Not empty.
[[nodiscard]] std::vector<float> pooled(const Recognizer& model,
                                        std::span<const std::vector<float>> templates);

// Greater is more alike. default, deep: cosine, -1..1 (of whitened faces, in all directions); the others:
// minus the distance (Euclidean in the subspace; chi-square), 0 at best.
[[nodiscard]] double compare(const Recognizer& model, std::span<const float> a,
                             std::span<const float> b);

// The template that is most alike; of equals the first.
struct Nearest {
  int index = -1;  // into templates
  double score = 0;
};
[[nodiscard]] std::optional<Nearest> nearest_template(const Recognizer& model,
                                                      std::span<const float> probe);

struct PersonScore {
  int person = 0;    // index into labels
  double score = 0;  // of the best template; default: mixed with that of the mean template
  int nearest = 0;   // index into templates, of this person
};
// Everyone with a template whom no negative rules out, best first, of equals the one with the lower
// index.
[[nodiscard]] std::vector<PersonScore> identify(const Recognizer& model, const cv::Mat& face);
[[nodiscard]] std::vector<PersonScore> identify_template(const Recognizer& model,
                                                         std::span<const float> probe);
// The first of them, without sorting the others.
[[nodiscard]] std::optional<PersonScore> best_person(const Recognizer& model,
                                                     std::span<const float> probe);

// Enrols a face without learning the subspace again. Returns the index of the template.
int add_face(Recognizer& model, const cv::Mat& face, const std::string& label);
// Removes the person's templates and name. The subspace and the calibration still depend on the
// images: train again to forget for good. Returns whether there was such a person.
bool remove_person(Recognizer& model, const std::string& label);

// Looking inside eigen and fisher models.
[[nodiscard]] cv::Mat mean_face(const Recognizer& model);               // CV_8UC1
[[nodiscard]] cv::Mat component_image(const Recognizer& model, int i);  // CV_8UC1, stretched
// The face that the subspace holds of this one (least squares), CV_8UC1 of the model's size.
[[nodiscard]] cv::Mat reconstruction(const Recognizer& model, const cv::Mat& face);
// sqrt(sum of squared grey differences) / pixels, the classical measure: small is alike.
[[nodiscard]] double reconstruction_error(const Recognizer& model, const cv::Mat& face);

// Files of type "face-recognizer". Throw ModelError(path), OutputError.
void write_recognizer(const std::string& path, const Recognizer& model,
                      const nlohmann::json& provenance);
[[nodiscard]] Recognizer read_recognizer(const std::string& path);
// The same as text, for databases: the second throws ModelError(path) for what is damaged.
[[nodiscard]] std::string recognizer_text(const Recognizer& model);
[[nodiscard]] Recognizer recognizer_from_text(std::string_view text, const std::string& path);

}  // namespace tarsier::face::recognition
