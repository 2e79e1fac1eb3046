// SPDX-License-Identifier: MIT
// fuzz_seeds FOLDER: writes the seed inputs that are not text (FOLDER/TARGET/good-*): tiny models
// of each kind, images, streams and databases. The bytes are the same each time, except for the
// databases.
#include "tarsier/core/progress.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/appearance/testing_portraits.h"
#include "tarsier/face/detect/anchor_detector.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/detect/testing_anchors.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head/testing_head.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/onnx/testing_onnx.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/cell_index.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/face/recognition/testing_deep.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/gradient_features.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/face/regression/quality.h"
#include "tarsier/face/regression/trees.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/capture_protocol.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/image_targets/target_io.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/plate_svm.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/tracking/log.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "seeds.h"
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier {

static std::string root;

std::string seed(const std::string& target, const std::string& name) {
  std::filesystem::create_directories(root + "/" + target);
  return root + "/" + target + "/good-" + name;
}

cv::Mat texture(cv::Size size) {
  cv::Mat gray(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      gray.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>((x * x + 3 * y + x * y / 7) & 0xff);
  return gray;
}

namespace {

namespace fs = std::filesystem;

const nlohmann::json kNothing = nlohmann::json::object();
NoProgress quiet;
const std::stop_token kNeverStop;

void images() {
  cv::Mat colour;
  cv::cvtColor(texture({20, 12}), colour, cv::COLOR_GRAY2BGR);
  for (const char* ending : {".png", ".jpg", ".webp", ".bmp", ".ppm"})
    write_image(seed("image", std::string("colour") + ending), colour);
  for (const char* ending : {".png", ".jpg", ".pgm"})
    write_image(seed("image", std::string("gray") + ending), texture({12, 20}));
  const std::vector<std::uint8_t> jpeg = encode_image(".jpg", colour, "seed", 40);
  // A part of multipart/x-mixed-replace, and consecutive images.
  const std::string image(jpeg.begin(), jpeg.end());
  const std::string part =
      "--b\r\nContent-Type: image/jpeg\r\nContent-Length: " + std::to_string(image.size()) +
      "\r\n\r\n" + image + "\r\n";
  write_file_atomically(seed("mjpeg", "multipart"), part + part);
  write_file_atomically(seed("mjpeg", "images"), image + image);
  // Records of a viewer's camera.
  const auto record = [](const std::string& bytes) {
    return std::string{'\0', '\0', static_cast<char>(bytes.size() >> 8U),
                       static_cast<char>(bytes.size())} +
           bytes;
  };
  write_file_atomically(seed("viewer", "images"), record(image) + record(image));
  write_file_atomically(seed("viewer", "cut"), record("no") + record(image.substr(0, 300)));
}

void capture() {
  const auto record = [](CaptureRecord header, const std::string& body) {
    header.length = body.size();
    std::string bytes(sizeof header, '\0');
    std::memcpy(bytes.data(), &header, sizeof header);
    return bytes + body;
  };
  CaptureRecord info;
  info.kind = CaptureRecord::Kind::kInfo;
  info.fps = 25;
  CaptureRecord frame;
  frame.width = 4;
  frame.height = 3;
  frame.type = CV_8UC3;
  frame.frames = 1;
  CaptureRecord end;
  end.kind = CaptureRecord::Kind::kError;
  write_file_atomically(seed("capture", "frames"),
                        record(info, "a camera") + record(frame, std::string(36, 'x')) +
                            record(frame, std::string(36, 'y')) + record(end, "gone"));
}

// Five points, two modes.
face::shape::ShapeModel small_shape() {
  Eigen::Matrix2Xd mean(2, 5);
  mean << -1, 1, 0, -0.7, 0.7, -1, -1, 0.1, 1, 1;
  std::vector<Eigen::Matrix2Xd> shapes;
  Rng rng(7);
  for (int k = 0; k < 8; ++k) {
    Eigen::Matrix2Xd shape = mean * 30;
    for (Eigen::Index i = 0; i < shape.size(); ++i) shape.data()[i] += 2 * rng.normal();
    shapes.push_back(shape);
  }
  face::shape::ShapeModel model = face::shape::train_shape_model(shapes, {.max_modes = 2});
  model.mirror = {1, 0, 2, 4, 3};
  model.connections = {{0, 1}, {3, 4}};
  return model;
}

face::regression::Descent::Stage small_stage(Eigen::Index outputs, Eigen::Index points) {
  face::regression::Descent::Stage stage;
  stage.scale = {10, 0.2};
  stage.center = Eigen::VectorXf::Constant(face::regression::kDescriptor, 0.1F);
  stage.components = Eigen::MatrixXf::Identity(face::regression::kDescriptor, 1);
  stage.weights = Eigen::MatrixXf::Constant(outputs, points, 0.01F);
  stage.bias = Eigen::VectorXf::Constant(outputs, 0.1F);
  return stage;
}

void landmark_models() {
  const face::shape::ShapeModel shape = small_shape();
  face::shape::write_shape_model(seed("shape_model", "five.json"), shape, kNothing);

  face::landmarks::LandmarkModel model;
  model.shape = shape;
  model.eyes = {0, 1};
  face::landmarks::LandmarkModel trees = model;
  face::regression::Trees::Level level;
  level.anchor = {0, 3};
  level.offset = Eigen::Matrix2Xf::Constant(2, 2, 0.1F);
  level.first = {0};
  level.second = {1};
  level.threshold = {3};
  level.basis = Eigen::MatrixXf::Constant(10, 2, 0.001F);
  level.leaves = {5, -5, 4, 3};
  trees.trees = face::regression::Trees{shape.mean, 1, 0.05F, {level, level}};
  face::landmarks::write_landmark_model(seed("landmark_model", "trees.json"), trees, kNothing);
  face::landmarks::LandmarkModel descent = model;
  descent.descent = face::regression::Descent{shape.mean, {small_stage(10, 5)}};
  descent.quality = face::regression::Quality{shape.mean, small_stage(1, 5)};
  face::landmarks::write_landmark_model(seed("landmark_model", "descent.json"), descent, kNothing);
  face::regression::PatchModels patches;
  patches.reference = shape.mean * 25;
  cv::Mat patch(3, 3, CV_32FC1, cv::Scalar(0));
  patch.at<float>(0, 0) = static_cast<float>(std::sqrt(0.5));
  patch.at<float>(2, 2) = -patch.at<float>(0, 0);
  patches.patches.assign(5, patch);
  face::landmarks::LandmarkModel with_patches = model;
  with_patches.patches = patches;
  face::landmarks::write_landmark_model(seed("landmark_model", "patches.json"), with_patches,
                                        kNothing);

  face::landmarks::HogDetector detector;
  detector.width = detector.height = 24;
  detector.weights =
      Eigen::MatrixXf::Constant(face::landmarks::kHogPlanes, detector.cells().area(), 0.01F);
  detector.threshold = 0.5;
  detector.box = face::landmarks::BoxModel{0.1, -0.1, 0.3, 7};
  face::landmarks::write_hog_detector(seed("hog_detector", "small.json"), detector, kNothing);
  face::write_anchor_detector(seed("anchor_detector", "bright.json"), face::bright_anchors(),
                              kNothing);
  face::write_face_networks(seed("face_networks", "untrained.json"), face::FaceNetworks(),
                            kNothing);

  face::appearance::AppearanceOptions options;
  options.frame_width = options.colour_width = 16;
  options.levels = 1;
  options.texture_modes = options.colour_modes = 2;
  options.shape.max_modes = 2;
  face::appearance::write_appearance_model(
      seed("appearance_model", "grid.json"),
      face::appearance::train_appearance_model(face::appearance::test_support::portraits(4, 1), {},
                                               options, quiet, kNeverStop),
      kNothing);
  face::head::write_head_model(seed("head_model", "formulas.json"), face::head::testing_head(2),
                               kNothing);
}

void plate_models() {
  using namespace plate;
  const auto one = [](int out) {
    linalg::Layer layer = linalg::convolution(1, out, 1, 1, false);
    layer.pad_y = layer.pad_x = 0;
    layer.weights.assign(static_cast<std::size_t>(out), 0.5F);
    layer.bias.assign(static_cast<std::size_t>(out), 0.1F);
    return layer;
  };
  DetectorModel detector;
  detector.detector.layers = {linalg::maximum(1, kCellSize, kCellSize), one(9)};
  detector.aligner.layers = {linalg::maximum(1, kAlignHeight, 64), linalg::maximum(1, 1, 2),
                             one(18)};
  write_detector_model(seed("plate_detector", "small.json"), detector, kNothing);
  ReaderModel reader;
  reader.line.layers = {linalg::maximum(1, kLineHeight, kColumnStride), one(kClasses)};
  write_reader_model(seed("plate_reader", "small.json"), reader, kNothing);

  PlateSvm svm;
  svm.features = PlateFeatures::kLbp;
  const cv::Mat blank(33, 144, CV_8UC1, cv::Scalar(0));
  svm.model.weights.assign(plate_features(blank, svm.features).size(), 0.01F);
  write_plate_svm(seed("plate_svm", "lbp.json"), svm, kNothing);

  CharacterReader characters;
  characters.symbols = "AB";
  characters.kind = ReaderKind::kMlp;
  characters.thumbnail_size = 1;
  Mlp& net = characters.mlp;
  net.inputs =
      static_cast<int>(projection_features(cv::Mat(20, 20, CV_8UC1, cv::Scalar(0)), 1).size());
  net.hidden = 2;
  net.outputs = 2;
  net.mean.assign(static_cast<std::size_t>(net.inputs), 0.5F);
  net.scale.assign(static_cast<std::size_t>(net.inputs), 2);
  net.hidden_weights.assign(2 * static_cast<std::size_t>(net.inputs + 1), 0.1F);
  net.output_weights.assign(6, 0.2F);
  write_character_reader(seed("character_reader", "mlp.json"), characters, kNothing);
}

void people_models() {
  write_file_atomically(seed("onnx_network", "means.onnx"),
                        face::onnx::testing_onnx::means_of_fields());
  write_file_atomically(
      seed("onnx_input_form", "three.txt"),
      "# of a test\nlicence: MIT\nsize: 112x96\nmean: 104 117 123\nscale: 0.0078\n");
  using namespace face::recognition;
  const SyntheticFaces set = synthetic_faces(3, 3, 0.2, 1, 0, {16, 20});
  RecognizerOptions options;
  options.descriptor.size = {16, 16};
  options.descriptor.channels.resize(1);
  options.descriptor.channels[0].cell = 8;
  options.descriptor.channels[0].directions = 4;
  options.lbp.grid = 2;
  options.lbp.neighbours = 4;
  options.variants = 0;
  options.size = {8, 10};
  std::string body;
  for (const Algorithm algorithm :
       {Algorithm::kDefault, Algorithm::kEigen, Algorithm::kFisher, Algorithm::kLbph}) {
    options.algorithm = algorithm;
    options.components = 3;
    const Recognizer model = train(set.faces, set.labels, options, quiet, kNeverStop);
    if (algorithm == Algorithm::kDefault) body = recognizer_text(model);
    write_recognizer(seed("recognizer", std::string(name_of(algorithm)) + ".json"), model,
                     kNothing);
  }
  BackgroundOptions general;
  general.descriptor = options.descriptor;
  general.components = 3;
  const SyntheticFaces others = synthetic_faces(6, 1, 0.2, 1, 10, {16, 20});
  write_deep_weights(seed("face_embedding", "tiny.json"), tiny_deep_weights(1), kNothing);
  write_file_atomically(
      seed("weights_manifest", "one.json"),
      std::string_view(
          R"([{"weights": [{"name": "fc", "shape": [16, 60], "dtype": "float32"}, {"name": "s",
"shape": [256], "dtype": "float32", "quantization": {"dtype": "uint8", "scale": 0.1, "min": -1}}],
"paths": ["shard.bin"]}])"));
  write_background(seed("background", "small.json"),
                   learn_background(others.faces, general, quiet, kNeverStop), kNothing);

  (void)write_cell_index(
      seed("face_index", "small"), 3, 5,
      [](std::int64_t step, const auto& take) {
        std::vector<std::int64_t> ids;
        for (std::int64_t i = 1; i <= 5; i += step) ids.push_back(i);
        take(ids, Rows::Constant(static_cast<Eigen::Index>(ids.size()), 3, 0.5F));
      },
      {5, -1, 1}, {.cells = 2}, quiet, kNeverStop);

  const std::string path = seed("gallery", "one.db");
  fs::remove(path);
  face::people::Gallery gallery(path);
  face::people::StoredFace face;
  face.crop = set.faces[0];
  face.features = {0.1F, 0.2F, 0.3F};
  face.measures = "{}";
  face.source = "a.png";
  face.time = 1'700'000'000'000;
  face.space = 1;
  const std::int64_t id = gallery.enroll("Ada", "agreed", face);
  gallery.add_sighting(face.time, "0", "Ada", true, 0.9);
  const std::pair<std::int64_t, std::vector<float>> numbers{id, face.features};
  (void)gallery.store_model(body, gallery.generation(), 0, {{id}}, {{numbers}});
}

void plate_logs() {
  const std::string path = seed("plate_log", "one.db");
  fs::remove(path);
  plate::PlateLog log(path);
  plate::PlateEvent event;
  event.id = 1;
  event.text = "1234BCD";
  event.confidence = 0.9;
  event.country = "es";
  event.candidates = {{"1234BCD", 0.9, "es"}};
  event.frames = 1;
  event.readings = {{0, 0.0, "1234BCD", 0.9, {10, 20, 100, 20}}};
  event.best_box = {10, 20, 100, 20};
  event.best_crop = texture({40, 12});
  event.source = "drive.avi";
  event.first_seen = event.last_seen = plate::Moment(std::chrono::hours(24));
  log.append(event);
  event.state = plate::PlateState::kOpened;
  event.synchronized = false;
  (void)log.put(event, 0, log.begin_run("1", [](const std::string&) { return true; }), {});
}

void targets() {
  planar::image_targets::TrainOptions options;
  options.frontal_features = 50;
  options.tilted_features = 0;
  options.max_features = 50;
  options.longer_side = 64;
  options.trials = 0;
  Rng rng(3);
  cv::Mat image(64, 64, CV_8UC1, cv::Scalar(128));
  for (int k = 0; k < 25; ++k) {
    const cv::Scalar tone(rng.integer(0, 255));
    cv::rectangle(image, {rng.integer(0, 55), rng.integer(0, 55), 9, 8}, tone, cv::FILLED);
  }
  planar::image_targets::write_target(
      seed("target", "blocks.json"), planar::image_targets::train_target(image, "blocks", options));
}

}  // namespace
}  // namespace tarsier

int main(int argc, char** argv) {
  if (argc != 2) {
    std::printf("fuzz_seeds FOLDER\n");
    return 2;
  }
  tarsier::root = argv[1];
  try {
    tarsier::images();
    tarsier::capture();
    tarsier::landmark_models();
    tarsier::plate_models();
    tarsier::people_models();
    tarsier::plate_logs();
    tarsier::reconstruction_seeds();
    tarsier::targets();
  } catch (const std::exception& error) {
    std::printf("%s\n", error.what());
    return 1;
  }
  return 0;
}
