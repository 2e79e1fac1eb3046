// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/training.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/losses.h"
#include "tarsier/linalg/trainer.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::plate {
namespace {

// --- detection ---

constexpr int kMapPlanes = 10;  // label, weight of the corners, 8 corner offsets

void label_cells(const View& view, linalg::Shape map, std::vector<float>& target) {
  const auto plane = static_cast<std::size_t>(map.height) * static_cast<std::size_t>(map.width);
  target.assign(plane * kMapPlanes, 0.0F);
  for (const ViewPlate& plate : view.plates) {
    const Quad& q = plate.plate;
    if (!is_convex(q, 4)) continue;
    const float width = mean_width(q);
    const float height = mean_height(q);
    // Is the plate of the right size for this level? For slightly different sizes, both answers are
    // accepted.
    const bool fits = width >= kMinPlateWidth && width <= kMaxPlateWidth && height >= 5.5F;
    const cv::Matx33d unit_from_view = map_between(q, quad_of({-0.5F, -0.5F, 1, 1}));
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        const cv::Point2f centre((static_cast<float>(x) + 0.5F) * kCellSize - 0.5F,
                                 (static_cast<float>(y) + 0.5F) * kCellSize - 0.5F);
        const cv::Point2f at = transformed(unit_from_view, centre);
        // At least one cell in each direction.
        const float reach_x = std::max(0.22F, 4.6F / width);
        const float reach_y = std::max(0.35F, 4.6F / height);
        const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                              static_cast<std::size_t>(x);
        if (std::abs(at.x) < reach_x && std::abs(at.y) < reach_y && fits) {
          target[i] = 1;
          target[plane + i] = 1;
          for (std::size_t k = 0; k < 4; ++k) {
            target[plane * (2 + 2 * k) + i] = (q[k].x - centre.x) / kCornerUnit;
            target[plane * (3 + 2 * k) + i] = (q[k].y - centre.y) / kCornerUnit;
          }
        } else if (std::abs(at.x) < 0.5F + 4.0F / width && std::abs(at.y) < 0.5F + 4.0F / height &&
                   target[i] == 0) {
          const bool near_fit = width >= kMinPlateWidth * 0.5F && width <= kMaxPlateWidth * 2.0F;
          if (near_fit) target[i] = linalg::kIgnoredCell;
        }
      }
    }
  }
}

double detector_loss(const linalg::Example& example, const std::vector<float>& output,
                     linalg::Shape shape, std::vector<float>& derivative) {
  return linalg::map_loss({.values = 8, .weight = 2, .focal = 1.5F, .huber_delta = 0.06F},
                          example.target, output, shape, derivative);
}

// --- alignment ---

double aligner_loss(const linalg::Example& example, const std::vector<float>& output, linalg::Shape,
                    std::vector<float>& derivative) {
  // target: 8 plate, 8 text, plate?, two rows?, text known?
  double loss = linalg::logistic_loss(output[16], example.target[16], derivative[16]);
  if (example.target[16] < 0.5F) return loss;
  for (std::size_t k = 0; k < 16; ++k) {
    if (k >= 8 && example.target[18] < 0.5F) break;
    float d = 0;
    loss += 2 * linalg::huber(output[k] - example.target[k], 0.03F, d);
    derivative[k] = 2 * d;
  }
  if (example.target[18] > 0.5F) {
    loss += linalg::logistic_loss(output[17], example.target[17], derivative[17]);
  }
  return loss;
}

// --- line reader ---

double line_loss(const linalg::Example& example, const std::vector<float>& output,
                 linalg::Shape shape, std::vector<float>& derivative) {
  const auto columns = static_cast<std::size_t>(shape.width);
  double loss = 0;
  for (std::size_t t = 0; t < columns; ++t) {
    const float label = example.target[t];
    if (label == linalg::kIgnoredCell) continue;
    float top = output[t];
    for (std::size_t c = 0; c < kClasses; ++c) top = std::max(top, output[c * columns + t]);
    double sum = 0;
    for (std::size_t c = 0; c < kClasses; ++c)
      sum += std::exp(static_cast<double>(output[c * columns + t] - top));
    const auto right = static_cast<std::size_t>(label);
    for (std::size_t c = 0; c < kClasses; ++c) {
      const double p = std::exp(static_cast<double>(output[c * columns + t] - top)) / sum;
      derivative[c * columns + t] = static_cast<float>(p) - (c == right ? 1.0F : 0.0F);
      if (c == right) loss -= std::log(std::max(p, 1e-9));
    }
  }
  return loss;
}

// The centre of a character has its class; its outer parts and the gaps are blank. In between, both
// are accepted.
void label_columns(const std::vector<std::pair<cv::Rect2f, int>>& boxes, int columns,
                   bool blank_elsewhere, std::vector<float>& target) {
  target.assign(static_cast<std::size_t>(columns),
                blank_elsewhere ? static_cast<float>(kBlank) : linalg::kIgnoredCell);
  for (int t = 0; t < columns; ++t) {
    const float x = (static_cast<float>(t) + 0.5F) * kColumnStride - 0.5F;
    for (const auto& [box, label] : boxes) {
      const float center = box.x + box.width / 2;
      const float half = std::max(box.width / 2, 3.0F);
      const float distance = std::abs(x - center) / half;
      const float core = std::max(0.60F, 2.1F / half);
      auto& value = target[static_cast<std::size_t>(t)];
      if (distance < core)
        value = static_cast<float>(label);
      else if (distance < core + 0.2F && value == static_cast<float>(kBlank))
        value = linalg::kIgnoredCell;
      else if (distance < 1.15F && !blank_elsewhere && value == linalg::kIgnoredCell &&
               distance > core + 0.2F)
        value = static_cast<float>(kBlank);
    }
  }
}

Quad jitter(const Quad& quad, double along, double across, Rng& rng) {
  const float w = mean_width(quad);
  const float h = mean_height(quad);
  const auto higher = static_cast<float>(std::exp(rng.normal(0, across)));
  const auto wider = static_cast<float>(std::exp(rng.normal(0, along)));
  const auto draw = [&](double divisor) {
    const float y = h * static_cast<float>(rng.normal(0, across / divisor));
    const float x = w * static_cast<float>(rng.normal(0, along / divisor));
    return cv::Point2f(x, y);
  };
  Quad result = grow(quad, wider, higher);
  const cv::Point2f shift = draw(2);
  for (cv::Point2f& p : result) p += shift + draw(3);
  return result;
}

// Simulates the aligner's error: mostly small, sometimes large.
Quad misaligned(const Quad& text, int rows, Rng& rng) {
  const double far = rng.uniform() < 0.7 ? 1 : 2;
  return jitter(text, 0.03 * far, (rows == 2 ? 0.04 : 0.08) * far, rng);
}

// Boxes of the characters of one row, in the canvas.
std::vector<std::pair<cv::Rect2f, int>> boxes_in_canvas(const ViewPlate& plate, int row,
                                                        const cv::Matx33d& canvas_from_view) {
  std::vector<std::pair<cv::Rect2f, int>> boxes;
  for (const ViewPlate::Symbol& symbol : plate.symbols) {
    if (symbol.row != row) continue;
    const Quad quad = transformed(canvas_from_view, symbol.quad);
    const float left = (quad[0].x + quad[3].x) / 2;
    const float right = (quad[1].x + quad[2].x) / 2;
    boxes.emplace_back(cv::Rect2f(left, 0, right - left, kLineHeight), class_of(symbol.symbol));
  }
  return boxes;
}

bool synthetic_line(const ViewGenerator& views, Rng& rng, cv::Mat& canvas,
                    std::vector<float>& target) {
  ViewOptions options;
  options.drawn = 1;
  options.none = 0;
  options.centred = true;
  options.wild = views.wild;
  // From barely readable to large.
  const double width =
      rng.uniform() < 0.75 ? 55 * std::pow(2.6, rng.uniform()) : 140 * std::pow(2.0, rng.uniform());
  options.min_width = width;
  options.max_width = width * 1.02;
  options.size = {static_cast<int>(width * 1.35), static_cast<int>(width * 0.85)};
  const View view = views.make(options, rng);
  if (view.plates.empty() || !view.plates.back().has_text_quad) return false;
  const ViewPlate& plate = view.plates.back();
  Quad text = misaligned(plate.text, plate.rows, rng);
  int line_width = kLineWidth;
  int row = 0;
  if (plate.rows == 2) {
    row = rng.integer(0, 1);
    text = row == 0 ? part_of(text, 0, 1, 0, 0.47F) : part_of(text, 0, 1, 0.53F, 1);
    line_width = kHalfLineWidth;
  }
  if (!is_convex(text, 20)) return false;
  canvas = sample(view.gray, text, line_quad(line_width), {line_width, kLineHeight});
  const auto boxes = boxes_in_canvas(plate, row, map_between(text, line_quad(line_width)));
  label_columns(boxes, line_width / kColumnStride, true, target);
  return true;
}

// The line of text of a labelled crop: straight lines through the tops and bottoms of its boxes.
bool text_quad_of(const LabelledCrop& crop, Quad& text) {
  const auto& s = crop.symbols;
  if (s.size() < 3) return false;
  double sx = 0;
  double sxx = 0;
  double st = 0;
  double sxt = 0;
  double height = 0;
  for (const auto& symbol : s) {
    const double x = symbol.box.x + symbol.box.width / 2.0;
    const double y = symbol.box.y + symbol.box.height / 2.0;
    sx += x;
    sxx += x * x;
    st += y;
    sxt += x * y;
    height += symbol.box.height;
  }
  const auto n = static_cast<double>(s.size());
  const double spread = sxx - sx * sx / n;
  if (spread < 1) return false;
  const double slope = (sxt - sx * st / n) / spread;
  const double intercept = (st - slope * sx) / n;
  for (const auto& symbol : s) {
    const double residual = symbol.box.y + symbol.box.height / 2.0 -
                            (intercept + slope * (symbol.box.x + symbol.box.width / 2.0));
    if (std::abs(residual) > 0.25 * height / n) return false;  // two rows
  }
  // The boxes are upright: the box of a sloping character is taller than the character.
  const double pitch = (s.back().box.x - s.front().box.x) /
                       static_cast<float>(std::max(1, s.back().position - s.front().position));
  const double text_height = height / n - std::abs(slope) * pitch * 0.6;
  const double left = s.front().box.x - pitch * s.front().position;
  const double right =
      s.back().box.x + s.back().box.width + pitch * (crop.length - 1 - s.back().position);
  if (text_height < 6 || right - left < 20) return false;
  const auto at = [&](double x, double side) {
    return cv::Point2f(static_cast<float>(x),
                       static_cast<float>(intercept + slope * x + side * text_height / 2));
  };
  text = {at(left, -1), at(right, -1), at(right, 1), at(left, 1)};
  return true;
}

bool real_line(const LabelledCrop& crop, Rng& rng, cv::Mat& canvas, std::vector<float>& target) {
  Quad text;
  if (!text_quad_of(crop, text)) return false;
  cv::Mat gray;
  double weights[3];
  double sum = 0;
  for (double& weight : weights) sum += weight = rng.uniform(0.1, 1);
  const cv::Mat mix =
      (cv::Mat_<float>(1, 3) << weights[0] / sum, weights[1] / sum, weights[2] / sum);
  cv::transform(crop.image, gray, mix);
  // Sometimes smaller, as if from farther away.
  const double min_scale = std::min(1.0, 60.0 / mean_width(text));
  const double scale = min_scale * std::pow(1 / min_scale, std::sqrt(rng.uniform()));
  cv::resize(gray, gray, {}, scale, scale, cv::INTER_AREA);
  for (cv::Point2f& p : text) p *= scale;
  simulate_camera(gray, 0.6, rng);
  const Quad jittered = misaligned(text, 1, rng);
  if (!is_convex(jittered, 20)) return false;
  canvas = sample(gray, jittered, line_quad(kLineWidth), {kLineWidth, kLineHeight});
  const cv::Matx33d map = map_between(jittered, line_quad(kLineWidth));
  std::vector<std::pair<cv::Rect2f, int>> boxes;
  for (const auto& symbol : crop.symbols) {
    const float y = (symbol.box.y + symbol.box.height / 2) * static_cast<float>(scale);
    const float left = transformed(map, {symbol.box.x * static_cast<float>(scale), y}).x;
    const float right =
        transformed(map, {(symbol.box.x + symbol.box.width) * static_cast<float>(scale), y}).x;
    boxes.emplace_back(cv::Rect2f(left, 0, right - left, kLineHeight), class_of(symbol.symbol));
  }
  label_columns(boxes, kLineWidth / kColumnStride, false, target);
  return true;
}

// network = (1 - share) network + share other
void blend(linalg::Network& network, const linalg::Network& other, float share) {
  const auto mean = [&](std::vector<float>& values, const std::vector<float>& others) {
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = (1 - share) * values[i] + share * others[i];
  };
  for (std::size_t k = 0; k < network.layers.size(); ++k) {
    mean(network.layers[k].weights, other.layers[k].weights);
    mean(network.layers[k].bias, other.layers[k].bias);
  }
}

void run_training(linalg::Network& network, int steps, double rate, std::uint64_t seed,
                  std::string_view stage, const linalg::MakeExample& make, const linalg::Loss& loss,
                  Progress& progress, std::stop_token stop, bool is_trained = false) {
  Rng rng(seed);
  if (!is_trained) linalg::initialize(network, rng);
  linalg::TrainOptions options;
  options.steps = steps;
  options.rate = rate;
  options.seed = seed;
  linalg::train(network, options, stage, make, loss, progress, stop);
}

}  // namespace

void make_detector_example(const ViewGenerator& views, Rng& rng, linalg::Shape& shape,
                           std::vector<float>& input, std::vector<float>& target) {
  ViewOptions options;
  options.wild = views.wild;
  options.min_width = kMinPlateWidth * 0.9;
  options.max_width = kMaxPlateWidth * 1.1;
  const View view = views.make(options, rng);
  const cv::Mat contrast = local_contrast(view.gray);
  shape = {1, contrast.rows, contrast.cols};
  input.assign(contrast.ptr<float>(), contrast.ptr<float>() + contrast.total());
  label_cells(view, {1, contrast.rows / kCellSize, contrast.cols / kCellSize}, target);
}

void make_aligner_example(const ViewGenerator& views, Rng& rng, linalg::Shape& shape,
                          std::vector<float>& input, std::vector<float>& target) {
  ViewOptions options;
  options.wild = views.wild;
  options.size = {220, 150};
  options.min_width = 40;
  options.max_width = 130;
  options.drawn = 0.75;
  options.none = 0.15;
  options.centred = true;
  target.assign(19, 0.0F);
  const Quad canonical = aligner_quad();
  shape = {1, kAlignHeight, kAlignWidth};
  if (!views.hard_negatives.empty() && rng.uniform() < 0.2) {
    Quad quad;
    const View view = views.make_hard_negative(options, rng, quad);
    const Quad jittered = jitter(quad, 0.06, 0.12, rng);
    normalize(sample(view.gray, is_convex(jittered, 20) ? jittered : quad, canonical,
                     {kAlignWidth, kAlignHeight}),
              input);
    return;
  }
  const View view = views.make(options, rng);
  // The target is the plate nearest to the centre.
  const ViewPlate* plate = nullptr;
  const Quad frame = quad_of({0, 0, 219, 149});
  for (const ViewPlate& candidate : view.plates)
    if (is_convex(candidate.plate, 60) && box_iou(candidate.plate, frame) > 0 &&
        mean_width(candidate.plate) > 30 && mean_width(candidate.plate) < 160 &&
        std::abs(candidate.plate[0].x + candidate.plate[2].x - 220) < 60 &&
        std::abs(candidate.plate[0].y + candidate.plate[2].y - 150) < 40)
      plate = &candidate;
  Quad jittered;
  if (plate != nullptr && rng.uniform() < 0.93) {
    const double error = rng.uniform() < 0.5 ? 0.04 : 0.10;
    jittered = jitter(plate->plate, error, error * 2, rng);
    target[16] = 1;
    target[17] = plate->rows == 2 ? 1.0F : 0.0F;
    target[18] = plate->has_text_quad ? 1.0F : 0.0F;
  } else {
    const auto w = static_cast<float>(rng.uniform(30, 130));
    const float h = w / static_cast<float>(rng.uniform(1.3, 5.5));
    jittered = jitter(
        quad_of({static_cast<float>(rng.uniform(0, 219 - static_cast<double>(w))),
                 static_cast<float>(rng.uniform(0, std::max(1.0, 149 - static_cast<double>(h)))), w,
                 h}),
        0.05, 0.1, rng);
    for (const ViewPlate& candidate : view.plates)
      if (box_iou(candidate.plate, jittered) > 0.15F) plate = &candidate;
    if (plate != nullptr && box_iou(plate->plate, jittered) > 0.15F) {
      // Too close for a negative example: show the plate instead.
      jittered = jitter(plate->plate, 0.05, 0.1, rng);
      target[16] = 1;
      target[17] = plate->rows == 2 ? 1.0F : 0.0F;
      target[18] = plate->has_text_quad ? 1.0F : 0.0F;
    }
  }
  if (!is_convex(jittered, 20)) jittered = frame;
  const cv::Mat window = sample(view.gray, jittered, canonical, {kAlignWidth, kAlignHeight});
  normalize(window, input);
  if (target[16] < 0.5F || plate == nullptr) {
    target[16] = 0;
    return;
  }
  const cv::Matx33d map = map_between(jittered, canonical);
  const Quad plate_quad = transformed(map, plate->plate);
  const Quad text = plate->has_text_quad ? transformed(map, plate->text) : plate_quad;
  for (std::size_t i = 0; i < 4; ++i) {
    target[2 * i] = (plate_quad[i].x - canonical[i].x) / kCornerUnit;
    target[2 * i + 1] = (plate_quad[i].y - canonical[i].y) / kCornerUnit;
    target[8 + 2 * i] = (text[i].x - canonical[i].x) / kCornerUnit;
    target[9 + 2 * i] = (text[i].y - canonical[i].y) / kCornerUnit;
  }
}

void make_line_example(const ViewGenerator& views, const std::vector<LabelledCrop>& crops, Rng& rng,
                       linalg::Shape& shape, std::vector<float>& input,
                       std::vector<float>& target) {
  cv::Mat canvas;
  for (bool done = false; !done;) {
    if (!crops.empty() && rng.uniform() < 0.25) {
      const int number = rng.integer(0, static_cast<int>(crops.size()) - 1);
      done = real_line(crops[static_cast<std::size_t>(number)], rng, canvas, target);
    } else {
      done = synthetic_line(views, rng, canvas, target);
    }
  }
  shape = {1, canvas.rows, canvas.cols};
  normalize(canvas, input);
}

linalg::Network train_detector(const ViewGenerator& views, const TrainingOptions& options,
                               Progress& progress, std::stop_token stop) {
  linalg::Network network = detector_network();
  run_training(
      network, options.detector_steps, 3e-3, options.seed * 3 + 1, "detector",
      [&](std::int64_t, Rng& rng, linalg::Example& example) {
        make_detector_example(views, rng, example.shape, example.input, example.target);
      },
      detector_loss, progress, stop);
  return network;
}

std::vector<HardNegative> find_hard_negatives(const std::vector<Scene>& scenes,
                                              const linalg::Network& detector) {
  std::vector<std::vector<HardNegative>> negatives(scenes.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(scenes.size())), [&](const cv::Range& range) {
    linalg::Workspace workspace;
    DetectorOptions options;
    options.threshold = 0.3F;
    options.max_detections = 40;
    for (int i = range.start; i < range.end; ++i) {
      const auto number = static_cast<std::size_t>(i);
      cv::Mat gray;
      cv::cvtColor(scenes[number].image, gray, cv::COLOR_BGR2GRAY);
      for (const Detection& detection : detect(gray, detector, options, workspace)) {
        const bool real = std::any_of(
            scenes[number].plates.begin(), scenes[number].plates.end(), [&](const cv::Rect2f& box) {
              return box_overlap_of_smaller(quad_of(box), grow(detection.corners, 1.2F, 1.3F)) > 0;
            });
        if (!real) negatives[number].push_back({number, detection.corners});
      }
    }
  });
  std::vector<HardNegative> all;
  for (const auto& some : negatives) all.insert(all.end(), some.begin(), some.end());
  return all;
}

linalg::Network train_aligner(const ViewGenerator& views, const TrainingOptions& options,
                              Progress& progress, std::stop_token stop) {
  linalg::Network network = aligner_network();
  run_training(
      network, options.aligner_steps, 2e-3, options.seed * 3 + 2, "aligner",
      [&](std::int64_t, Rng& rng, linalg::Example& example) {
        make_aligner_example(views, rng, example.shape, example.input, example.target);
      },
      aligner_loss, progress, stop);
  return network;
}

linalg::Network train_line_reader(const ViewGenerator& views,
                                  const std::vector<LabelledCrop>& crops,
                                  const TrainingOptions& options, Progress& progress,
                                  std::stop_token stop, const linalg::Network* start) {
  constexpr double kRate = 2e-3;
  constexpr double kRateOfStart = 5e-4;
  linalg::Network network = line_network();
  if (start != nullptr) {
    const linalg::Shape input{1, kLineHeight, kLineWidth};
    TARSIER_REQUIRE(start->layers.size() == network.layers.size() &&
                        start->parameters() == network.parameters() &&
                        start->output(input) == network.output(input),
                    "a network of {} layers and {} numbers", start->layers.size(),
                    start->parameters());
    network = *start;
  }
  run_training(
      network, options.line_steps, start != nullptr ? kRateOfStart : kRate, options.seed * 3 + 3,
      "line reader",
      [&](std::int64_t, Rng& rng, linalg::Example& example) {
        make_line_example(views, crops, rng, example.shape, example.input, example.target);
      },
      line_loss, progress, stop, start != nullptr);
  if (start != nullptr && options.keep > 0)
    blend(network, *start, static_cast<float>(options.keep));
  return network;
}

CharacterErrors evaluate_line_reader(const linalg::Network& network,
                                     const std::vector<LabelledCrop>& crops) {
  CharacterErrors errors;
  linalg::Workspace workspace;
  for (const LabelledCrop& crop : crops) {
    Quad text;
    if (!text_quad_of(crop, text)) continue;
    cv::Mat gray;
    cv::cvtColor(crop.image, gray, cv::COLOR_BGR2GRAY);
    const cv::Mat probabilities = read_line(gray, text, kLineWidth, network, workspace);
    const cv::Matx33d map = map_between(text, line_quad(kLineWidth));
    for (const auto& symbol : crop.symbols) {
      const cv::Point2f center(symbol.box.x + symbol.box.width / 2,
                               symbol.box.y + symbol.box.height / 2);
      const float column = transformed(map, center).x / kColumnStride - 0.5F;
      // The two columns on either side of the centre, weighted by distance.
      const int left = std::clamp(static_cast<int>(std::floor(column)), 0, probabilities.rows - 2);
      const float share = std::clamp(column - static_cast<float>(left), 0.0F, 1.0F);
      int best = 0;
      float top = -1;
      for (int c = 0; c < kBlank; ++c) {
        const float p = (1 - share) * probabilities.at<float>(left, c) +
                        share * probabilities.at<float>(left + 1, c);
        if (p > top) {
          top = p;
          best = c;
        }
      }
      ++errors.characters;
      errors.wrong += kAlphabet[static_cast<std::size_t>(best)] != symbol.symbol;
    }
  }
  return errors;
}

}  // namespace tarsier::plate
