// SPDX-License-Identifier: MIT
#include "tarsier/synth/street.h"

#include "tarsier/core/require.h"
#include "tarsier/synth/car_sprite.h"
#include "tarsier/synth/glyphs.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>

namespace tarsier::synth {

// Its frame: x right, y down, z forward, m.
struct StreetCamera {
  cv::Size size;
  double focal;  // px
  cv::Point2d centre;

  explicit StreetCamera(cv::Size image_size)
      : size(image_size),
        focal(0.86 * image_size.width),
        centre(image_size.width / 2.0, image_size.height * 0.42) {}

  [[nodiscard]] cv::Point2f project(double x, double y, double z) const {
    return {static_cast<float>(centre.x + focal * x / z),
            static_cast<float>(centre.y + focal * y / z)};
  }
};

struct CarPose {
  double x = 0;    // m
  double z = 10;   // m
  double yaw = 0;  // rad; positive: its right side (in the image) is farther away
};

namespace {

constexpr double kEyeHeight = 1.7;  // m above the road
constexpr double kWheelRow = 606;   // of the sprite, contact of the tyres with the road
constexpr double kMetre = kBodyWidth / kCarMetres;  // px of the sprite

// Projection of a point of the sprite (px of its first level).
cv::Point2f seen(const StreetCamera& camera, const CarPose& pose, double sx, double sy) {
  const double across = (sx - kSpriteWidth / 2.0) / kMetre;
  return camera.project(pose.x + across * std::cos(pose.yaw),
                        kEyeHeight - (kWheelRow - sy) / kMetre,
                        pose.z + across * std::sin(pose.yaw));
}

using Quad = std::array<cv::Point2f, 4>;

Quad seen(const StreetCamera& camera, const CarPose& pose, const cv::Rect2f& box) {
  const auto at = [&](float x, float y) {
    return seen(camera, pose, static_cast<double>(x), static_cast<double>(y));
  };
  return {at(box.x, box.y), at(box.x + box.width, box.y), at(box.x + box.width, box.y + box.height),
          at(box.x, box.y + box.height)};
}

cv::Rect2f upright_box(const Quad& quad) {
  cv::Point2f low = quad[0];
  cv::Point2f high = quad[0];
  for (const cv::Point2f& p : quad) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  return {low, high};
}

void put_car(cv::Mat& image, const StreetCamera& camera, const CarPose& pose,
             const CarSprite& car) {
  const Quad corners = seen(camera, pose, {0, 0, kSpriteWidth, kSpriteHeight});
  const cv::Rect2f box = upright_box(corners);
  const cv::Rect window =
      cv::Rect(static_cast<int>(box.x) - 1, static_cast<int>(box.y) - 1,
               static_cast<int>(box.width) + 3, static_cast<int>(box.height) + 3) &
      cv::Rect({0, 0}, image.size());
  if (window.empty()) return;
  const double scale = static_cast<double>(box.width) / kSpriteWidth;
  const int level = std::clamp(static_cast<int>(std::floor(std::log2(1 / std::max(scale, 1e-3)))),
                               0, static_cast<int>(car.color.size()) - 1);
  const cv::Mat& color = car.color[static_cast<std::size_t>(level)];
  const auto step = static_cast<float>(kSpriteWidth) / static_cast<float>(color.cols);
  // Pixel centres: the level's (0, 0) is the centre of its first block.
  Quad from;
  for (std::size_t i = 0; i < 4; ++i) {
    const float x = i == 1 || i == 2 ? kSpriteWidth : 0;
    const float y = i >= 2 ? kSpriteHeight : 0;
    from[i] = {(x + 0.5F) / step - 0.5F, (y + 0.5F) / step - 0.5F};
  }
  Quad to = corners;
  for (cv::Point2f& p : to) p -= cv::Point2f(window.tl());
  const cv::Mat map = cv::getPerspectiveTransform(from.data(), to.data());
  cv::Mat paint;
  cv::Mat cover;
  cv::warpPerspective(color, paint, map, window.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::warpPerspective(car.alpha[static_cast<std::size_t>(level)], cover, map, window.size(),
                      cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  for (int y = 0; y < window.height; ++y) {
    auto* out = image.ptr<cv::Vec3b>(window.y + y) + window.x;
    const auto* in = paint.ptr<cv::Vec3b>(y);
    const std::uint8_t* a = cover.ptr(y);
    for (int x = 0; x < window.width; ++x) {
      if (a[x] == 0) continue;
      for (int c = 0; c < 3; ++c)
        out[x][c] = static_cast<std::uint8_t>((out[x][c] * (255 - a[x]) + in[x][c] * a[x]) / 255);
    }
  }
}

void put_shadow(cv::Mat& image, const StreetCamera& camera, const CarPose& pose) {
  const cv::Point2f middle = camera.project(pose.x, kEyeHeight, pose.z + 0.3);
  const cv::Size axes(std::max(1, cvRound(camera.focal * 1.05 / pose.z)),
                      std::max(1, cvRound(camera.focal * kEyeHeight * 0.9 / pose.z / pose.z)));
  cv::Rect window(cv::Point(middle) - cv::Point(axes.width, axes.height),
                  cv::Size(2 * axes.width + 1, 2 * axes.height + 1));
  const cv::Rect inside = window & cv::Rect({0, 0}, image.size());
  if (inside.empty()) return;
  for (int y = inside.y; y < inside.br().y; ++y) {
    for (int x = inside.x; x < inside.br().x; ++x) {
      const double u = (x - static_cast<double>(middle.x)) / axes.width;
      const double v = (y - static_cast<double>(middle.y)) / axes.height;
      const double depth = 1 - u * u - v * v;
      if (depth > 0) image.at<cv::Vec3b>(y, x) *= 1 - 0.55 * std::min(1.0, 2 * depth);
    }
  }
}

// The halo of a lamp.
void put_glow(cv::Mat& image, cv::Point2f at, double radius, const cv::Scalar& color) {
  const int reach = std::max(2, cvRound(radius * 3));
  const cv::Rect inside =
      cv::Rect(cvRound(at.x) - reach, cvRound(at.y) - reach, 2 * reach + 1, 2 * reach + 1) &
      cv::Rect({0, 0}, image.size());
  for (int y = inside.y; y < inside.br().y; ++y) {
    for (int x = inside.x; x < inside.br().x; ++x) {
      const double d2 = (std::pow(x - static_cast<double>(at.x), 2) +
                         std::pow(y - static_cast<double>(at.y), 2)) /
                        (radius * radius);
      const double w = std::exp(-d2) + 0.12 * std::exp(-d2 / 5);
      auto& pixel = image.at<cv::Vec3b>(y, x);
      for (int c = 0; c < 3; ++c)
        pixel[c] = cv::saturate_cast<std::uint8_t>(pixel[c] + w * color[c]);
    }
  }
}

// --- static objects ---

void draw_house(cv::Mat& image, const cv::Rect& wall, bool night, Rng& rng) {
  const double tone = rng.uniform(110, 215);
  const double green = tone * rng.uniform(0.8, 1);
  const cv::Scalar color(tone * rng.uniform(0.7, 0.95), green, tone);
  cv::rectangle(image, wall, color, cv::FILLED);
  const int storey = std::max(12, wall.height / rng.integer(3, 5));
  const int bay = std::max(12, wall.width / rng.integer(3, 6));
  for (int y = wall.y + storey / 4; y + storey / 2 < wall.br().y - storey; y += storey) {
    for (int x = wall.x + bay / 4; x + bay / 2 < wall.br().x; x += bay) {
      const bool lamp = night && rng.uniform() < 0.3;
      cv::rectangle(image, {x, y, bay / 2, storey / 2},
                    lamp ? cv::Scalar(400, 600, 700) : cv::Scalar(90, 80, 70), cv::FILLED);
      cv::rectangle(image, {x, y, bay / 2, storey / 2}, color * 0.75, 1);
    }
  }
  if (rng.uniform() < 0.7) {  // a shop sign: letters that are not a plate
    const cv::Rect sign(wall.x + wall.width / 8, wall.br().y - storey, wall.width * 3 / 4,
                        std::max(8, storey / 3));
    cv::rectangle(image, sign, {rng.uniform(0, 160), rng.uniform(0, 120), rng.uniform(0, 160)},
                  cv::FILLED);
    std::string name;
    for (int i = rng.integer(4, 9); i > 0; --i)
      name += kPlateSymbols[static_cast<std::size_t>(rng.integer(10, 35))];
    cv::putText(image, name, {sign.x + 4, sign.br().y - sign.height / 5}, cv::FONT_HERSHEY_DUPLEX,
                sign.height / 34.0, {235, 235, 235}, 1, cv::LINE_AA);
  }
}

cv::Mat draw_background(const StreetCamera& camera, StreetLight light, Rng& rng) {
  cv::Mat image(camera.size, CV_8UC3);
  const int horizon = cvRound(camera.centre.y);
  for (int y = 0; y < image.rows; ++y) {
    const double t = static_cast<double>(y) / std::max(1, horizon);
    const cv::Scalar sky(235 - 20 * t, 205 + 25 * t, 170 + 50 * t);
    const double grey = 96 + 34.0 * (y - horizon) / std::max(1, image.rows - horizon);
    image.row(y).setTo(y < horizon ? sky : cv::Scalar(grey, grey, grey - 3));
  }
  const bool night = light != StreetLight::kDay;
  for (const bool left : {true, false}) {  // a row of houses on each side, nearer ones larger
    for (double z = 46; z > 9; z -= rng.uniform(7, 11)) {
      const double x = left ? -rng.uniform(9, 11) : rng.uniform(9, 11);
      const cv::Point2f base = camera.project(x, kEyeHeight, z);
      const int height = cvRound(camera.focal * rng.uniform(7, 12) / z);
      const int width = cvRound(camera.focal * rng.uniform(6, 9) / z);
      draw_house(image,
                 {left ? cvRound(base.x) - width : cvRound(base.x), cvRound(base.y) - height, width,
                  height},
                 night, rng);
    }
  }
  const auto ground = [&](double x, double z) {
    return cv::Point(camera.project(x, kEyeHeight, z));
  };
  for (const double side : {-1.0, 1.0}) {  // pavement and kerb
    const std::vector<cv::Point> pavement{ground(side * 5.6, 60), ground(side * 12, 60),
                                          ground(side * 12, 2), ground(side * 5.6, 2)};
    cv::fillConvexPoly(image, pavement, {150, 152, 155}, cv::LINE_AA);
    cv::line(image, ground(side * 5.6, 60), ground(side * 5.6, 2), {190, 190, 190}, 2, cv::LINE_AA);
  }
  for (double z = 2.2; z < 60; z += 3.4) {  // the lane marking
    const std::vector<cv::Point> dash{ground(-0.27, z), ground(-0.13, z), ground(-0.13, z + 1.6),
                                      ground(-0.27, z + 1.6)};
    cv::fillConvexPoly(image, dash, {225, 225, 225}, cv::LINE_AA);
  }
  // Grain, so that uniform areas are not flat.
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<cv::Vec3b>(y);
    for (int x = 0; x < image.cols; ++x) {
      const double grain = rng.normal(0, 3.5);
      for (int c = 0; c < 3; ++c) row[x][c] = cv::saturate_cast<std::uint8_t>(row[x][c] + grain);
    }
  }
  cv::GaussianBlur(image, image, {}, 0.8);
  if (light == StreetLight::kDay) return image;
  if (light == StreetLight::kNight) {
    image.convertTo(image, -1, 0.2, 0);
    for (double z = 34; z > 8; z -= 8)
      for (const double x : {-6.5, 6.5})
        put_glow(image, camera.project(x, kEyeHeight - 5, z), camera.focal * 0.22 / z,
                 {110, 190, 230});
    return image;
  }
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  gray.convertTo(gray, -1, 0.14, 3);
  cv::cvtColor(gray, image, cv::COLOR_GRAY2BGR);
  return image;
}

std::string any_text(PlateKind kind, Rng& rng) {
  if (kind != PlateKind::kSpain && kind != PlateKind::kSpainSquare && kind != PlateKind::kSpainMoto)
    return {};
  constexpr std::string_view kLetters = "BCDFGHJKLMNPRSTVWXYZ";
  std::string text;
  for (int i = 0; i < 4; ++i) text += static_cast<char>('0' + rng.integer(0, 9));
  for (int i = 0; i < 3; ++i) text += kLetters[static_cast<std::size_t>(rng.integer(0, 19))];
  return text;
}

StreetImage compose(const cv::Mat& background, const StreetCamera& camera, StreetLight light,
                    std::vector<std::pair<const CarSprite*, std::pair<int, CarPose>>> cars) {
  std::stable_sort(cars.begin(), cars.end(), [](const auto& a, const auto& b) {
    return a.second.second.z > b.second.second.z;
  });
  StreetImage result;
  result.image = background.clone();
  for (std::size_t i = 0; i < cars.size(); ++i) {
    const CarSprite& car = *cars[i].first;
    const CarPose& pose = cars[i].second.second;
    if (light == StreetLight::kDay) put_shadow(result.image, camera, pose);
    put_car(result.image, camera, pose, car);
    if (light != StreetLight::kDay) {
      for (const cv::Rect2f& lamp : car.lamps) {
        const cv::Point2f at =
            seen(camera, pose, lamp.x + lamp.width / 2, lamp.y + lamp.height / 2);
        const double radius = camera.focal * (car.rear ? 0.07 : 0.11) / pose.z;
        const double strength = light == StreetLight::kInfrared ? 0.5 : 1;
        const cv::Scalar color = light == StreetLight::kInfrared ? cv::Scalar(200, 200, 200)
                                 : car.rear                      ? cv::Scalar(40, 40, 230)
                                                                 : cv::Scalar(240, 250, 250);
        put_glow(result.image, at, radius, color * strength);
      }
    }
    StreetPlate plate;
    plate.id = cars[i].second.first;
    plate.text = car.text;
    plate.corners = seen(camera, pose, car.plate);
    const cv::Rect2f inside(0, 0, static_cast<float>(camera.size.width - 1),
                            static_cast<float>(camera.size.height - 1));
    plate.visible = std::all_of(plate.corners.begin(), plate.corners.end(),
                                [&](const cv::Point2f& p) { return inside.contains(p); });
    for (std::size_t k = i + 1; k < cars.size() && plate.visible; ++k) {
      const Quad cover = seen(camera, cars[k].second.second, {30, 60, kSpriteWidth - 60, 546});
      const std::vector<cv::Point2f> outline(cover.begin(), cover.end());
      for (const cv::Point2f& p : plate.corners)
        plate.visible = plate.visible && cv::pointPolygonTest(outline, p, false) < 0;
    }
    result.plates.push_back(plate);
  }
  if (light == StreetLight::kInfrared) {
    // Resampling rounds the channels differently; an infrared camera has only one.
    cv::Mat gray;
    cv::cvtColor(result.image, gray, cv::COLOR_BGR2GRAY);
    cv::cvtColor(gray, result.image, cv::COLOR_GRAY2BGR);
  }
  return result;
}

}  // namespace

void StreetOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!kinds.empty(), "no kind of plate");
  TARSIER_REQUIRE(cars >= 1 && cars <= 60 && parked >= 0 && distant >= 0 && parked <= 3 &&
                      distant <= 3 && parked + distant <= cars,
                  "{} cars, {} parked, {} far", cars, parked, distant);
}

// --- a drive ---

struct Drive::Parts {
  enum class Role { kParked, kDistant, kApproaching, kReceding };
  struct Car {
    Role role;
    CarSprite sprite;
    CarPose pose;  // parked and far: its fixed position
    double start;  // s
    double speed;  // m/s
  };
  StreetOptions options;
  StreetCamera camera;
  cv::Mat background;
  std::vector<Car> cars;

  explicit Parts(const StreetOptions& street_options)
      : options(street_options), camera(street_options.size) {}

  // Sets the position of a car; returns whether it is on the street.
  [[nodiscard]] bool place(const Car& car, double time, CarPose& pose) const {
    constexpr double kHorizon = 90;
    pose = car.pose;
    const double t = time - car.start;
    switch (car.role) {
      case Role::kParked:
        return true;
      case Role::kDistant: {  // arrives, waits, and returns
        const double stay = options.seconds * 0.3;
        const double horizon_distance = (kHorizon - car.pose.z) / car.speed;
        const double travelled = t < 0 ? -t : t > stay ? t - stay : 0;
        pose.z += car.speed * std::min(travelled, horizon_distance);
        return travelled < horizon_distance;
      }
      case Role::kApproaching:
        pose.z = kHorizon - car.speed * t;
        return t > 0 && pose.z > 1.2;
      case Role::kReceding:
        pose.z = 1.2 + car.speed * t;
        return t > 0 && pose.z < kHorizon;
    }
    return false;
  }
};

Drive::Drive(const StreetOptions& options) {
  options.check();
  const auto glyphs = load_glyphs();
  const Rng base(options.seed);
  auto parts = std::make_unique<Parts>(options);
  Rng scenery = base.fork(1);
  parts->background = draw_background(parts->camera, options.light, scenery);
  const int passing = options.cars - options.parked - options.distant;
  for (int i = 0; i < options.cars; ++i) {
    Rng rng = base.fork(static_cast<std::uint64_t>(i) + 10);
    const PlateKind kind = options.kinds[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(options.kinds.size()) - 1))];
    Parts::Car car{};
    car.sprite = draw_car(*glyphs, options.light, kind, any_text(kind, rng), rng);
    if (i < options.parked) {
      car.role = Parts::Role::kParked;
      car.pose = {3.7 + 0.2 * i, 7.6 + 4.2 * i, -0.12};
    } else if (i < options.parked + options.distant) {
      const int number = i - options.parked;
      car.role = Parts::Role::kDistant;
      car.pose = {-4.6 - 0.3 * number,
                  parts->camera.focal * 0.52 / (50.0 * options.size.width / 1280) + 2.5 * number,
                  0.08};
      car.start = options.seconds * (0.3 + 0.2 * number);
      car.speed = 6;
    } else {
      const int number = i - options.parked - options.distant;
      car.role = number % 2 == 0 ? Parts::Role::kApproaching : Parts::Role::kReceding;
      car.speed = rng.uniform(5, 8);
      car.pose.x = car.role == Parts::Role::kApproaching ? -1.75 : 1.35;
      car.pose.yaw = rng.normal(0, 0.05);
      // The times of passing are evenly spread.
      const double near = options.seconds * (number + 0.6) / (passing + 0.2);
      car.start = near - (car.role == Parts::Role::kApproaching ? 86 / car.speed : 2 / car.speed);
    }
    parts->cars.push_back(std::move(car));
  }
  parts_ = std::move(parts);
}

Drive::~Drive() = default;
Drive::Drive(Drive&&) noexcept = default;
Drive& Drive::operator=(Drive&&) noexcept = default;

StreetImage Drive::at(double time) const {
  std::vector<std::pair<const CarSprite*, std::pair<int, CarPose>>> visible_cars;
  for (std::size_t i = 0; i < parts_->cars.size(); ++i) {
    CarPose pose;
    if (parts_->place(parts_->cars[i], time, pose))
      visible_cars.push_back({&parts_->cars[i].sprite, {static_cast<int>(i) + 1, pose}});
  }
  return compose(parts_->background, parts_->camera, parts_->options.light,
                 std::move(visible_cars));
}

std::vector<std::string> Drive::texts() const {
  std::vector<std::string> result;
  for (const Parts::Car& car : parts_->cars) result.push_back(car.sprite.text);
  return result;
}

// --- single scenes ---

namespace {

std::shared_ptr<const GlyphSet> installed_glyphs() {
  static const std::shared_ptr<const GlyphSet> glyphs = load_glyphs();
  return glyphs;
}

// The typefaces of the last seed are cached.
std::shared_ptr<const GlyphSet> drawn_glyphs(std::uint64_t seed) {
  constexpr int kTypefaces = 60;
  static std::mutex mutex;
  static std::uint64_t last = 0;
  static std::shared_ptr<const GlyphSet> glyphs;
  const std::scoped_lock lock(mutex);
  if (glyphs == nullptr || last != seed) {
    glyphs = draw_glyphs(seed, kTypefaces);
    last = seed;
  }
  return glyphs;
}

}  // namespace

StreetImage render_car(const StreetOptions& options, std::uint64_t number) {
  options.check();
  const std::shared_ptr<const GlyphSet> glyphs =
      options.wild ? drawn_glyphs(options.seed) : installed_glyphs();
  Rng rng = Rng(options.seed).fork(number + 1000);
  const StreetCamera camera(options.size);
  const cv::Mat background = draw_background(camera, options.light, rng);
  std::vector<CarSprite> sprites;
  std::vector<CarPose> poses;
  const int count = rng.uniform() < 0.35 ? 2 : 1;
  // Any nearer, a plate 1.45 m below the eye would be below the image.
  const double nearest = camera.focal * 1.5 / (options.size.height - camera.centre.y);
  for (int i = 0; i < count; ++i) {
    const PlateKind kind = options.kinds[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(options.kinds.size()) - 1))];
    sprites.push_back(
        draw_car(*glyphs, options.light, kind, any_text(kind, rng), rng, options.wild));
    CarPose pose;
    pose.z = nearest * std::pow(options.max_distance_ratio, rng.uniform());
    const double reach = pose.z * options.size.width / camera.focal / 2 - 1.1;
    pose.x = count == 1 ? rng.uniform(-0.8, 0.8) * std::max(0.1, reach)
                        : (i == 0 ? -1 : 1) * rng.uniform(1.0, std::max(1.05, reach));
    pose.yaw = std::clamp(rng.normal(0, 0.25), -0.6, 0.6);
    poses.push_back(pose);
  }
  std::vector<std::pair<const CarSprite*, std::pair<int, CarPose>>> visible_cars;
  for (int i = 0; i < count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    visible_cars.push_back({&sprites[k], {i + 1, poses[k]}});
  }
  return compose(background, camera, options.light, std::move(visible_cars));
}

}  // namespace tarsier::synth
