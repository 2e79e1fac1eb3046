// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/cartoon/options.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/lazy_opencv.h"
#include "tarsier/synth/portrait.h"
#include "tarsier/synth/scene.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "demo.h"
#include "framework/stopwatch.h"
#include "verbs/program/sample_images.h"
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <optional>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using cartoon::Cartoonizer;
using cartoon::CartoonizerState;
using cartoon::CartoonOptions;
using cartoon::Mode;

struct Sample {
  std::string name;  // "home"
  std::string path;  // as a user would type it
  cv::Mat image;     // CV_8UC3
};

// Sample images of the package opencv-doc if it is installed, else synthetic ones.
std::vector<Sample> samples() {
  std::vector<Sample> result;
  for (const char* name : {"home", "baboon", "squirrel_cls", "messi5"}) {
    const std::string path = sample_image(fmt::format("{}.jpg", name));
    if (!fs::exists(path)) continue;
    try {
      result.push_back({name, path, read_image(path)});
    } catch (const Error& error) {
      log_warning("{}", error.what());
    }
  }
  if (result.empty()) {
    result.push_back({"scene", "synth:scene", synth::render_scene({640, 480})});
    result.push_back({"scene-2", "'synth:scene?seed=2'", synth::render_scene({640, 480}, 0, 2)});
  }
  return result;
}

// With the default, images full of texture would get too much ink. The default is for faces in
// front of a plain wall.
constexpr int kEvilThreshold = 60;

CartoonOptions options_for(Mode mode) {
  CartoonOptions options;
  options.mode = mode;
  options.evil.threshold = kEvilThreshold;
  return options;
}

cv::Mat cartoonize(const cv::Mat& image, const CartoonOptions& options,
                   DebugSink* stages = nullptr) {
  Frame frame;
  frame.image = image;
  frame.still = true;
  CartoonizerState state;
  return Cartoonizer::load(ModelStore::find(), options).process(frame, state, stages).image;
}

// --- parts of the page ---

struct ModeText {
  Mode mode;
  const char* text;
};

constexpr ModeText kModes[] = {
    {Mode::kCartoon, "cartoon: the painting with pencil lines"},
    {Mode::kSketch, "sketch: pencil lines alone"},
    {Mode::kPaint, "paint: flat colours, sharp edges"},
    {Mode::kEvil, "evil: the painting with heavy ink"},
    {Mode::kEvilSketch, "evil-sketch: heavy ink only"},
};

void add_samples(Context& context, DemoPage& page, const std::vector<Sample>& images) {
  const Sample& first = images.front();
  const cv::Mat first_cartoon = cartoonize(first.image, options_for(Mode::kCartoon));
  page.compare(page.image(fmt::format("{}-original", first.name), first.image, "the image"),
               page.image(fmt::format("{}-cartoon", first.name), first_cartoon, "the cartoon"));
  page.command(fmt::format("tarsier cartoon run {} -o cartoon.png", first.path));

  page.heading("Every mode",
               "All modes on different images. The sketch modes draw only lines. The paint mode "
               "smooths the texture and preserves the colours.");
  for (const Sample& sample : images) {
    throw_if_stopped(context.stop);
    std::vector<DemoImage> row{page.image(sample.name + "-original", sample.image, "original")};
    for (const ModeText& mode : kModes) {
      const cv::Mat image = cartoonize(sample.image, options_for(mode.mode));
      const std::string name = fmt::format("{}-{}", sample.name, cartoon::name_of(mode.mode));
      const bool lines = mode.mode == Mode::kSketch || mode.mode == Mode::kEvilSketch;
      row.push_back(lines ? page.drawing(name, image, mode.text)
                          : page.image(name, image, mode.text));
      context.progress->advance();
    }
    page.grid(row);
  }
  page.command(fmt::format("tarsier cartoon run {} --mode evil --evil-threshold {} -o evil.png",
                           first.path, kEvilThreshold));
}

void add_faces(Context& context, DemoPage& page) {
  throw_if_stopped(context.stop);
  const cv::Mat portrait = synth::render_portrait({640, 480}).image;
  const auto alien = [&](cartoon::SkinStyle style, const cv::Scalar& color) {
    CartoonOptions options = options_for(Mode::kAlien);
    options.skin.style = style;
    options.skin.color = color;
    context.progress->advance();
    return cartoonize(portrait, options);
  };
  const cv::Mat green = alien(cartoon::SkinStyle::kGlow, CartoonOptions().skin.color);
  const cv::Mat blue = alien(cartoon::SkinStyle::kTint, {190, 90, 20});
  const cv::Mat smooth = cartoonize(portrait, options_for(Mode::kSmooth));
  cv::Mat outline = portrait.clone();
  cartoon::draw_face_outline(outline, 0.8);
  page.heading("Faces",
               "Skin is detected from six points of the expected face region, and recoloured. In "
               "live mode, an outline shows for two seconds where to hold the face; --face auto "
               "detects the face instead. This face is rendered by the program.");
  page.grid(
      {page.image("face-original", portrait, "original"),
       page.image("face-outline", outline, "face position"),
       page.image("face-cartoon", cartoonize(portrait, options_for(Mode::kCartoon)), "cartoon"),
       page.image("face-alien", green, "alien"),
       page.image("face-alien-blue", blue, "alien, tinted blue"),
       page.image("face-smooth", smooth, "smooth: skin only")});
  page.command("tarsier cartoon run 0 --mode alien --window");
}

// Stores the stages of one run as images of the page.
class StageStrip final : public DebugSink {
 public:
  StageStrip(DemoPage& page, std::string prefix) : page_(page), prefix_(std::move(prefix)) {}
  void image(std::string_view name, const cv::Mat& image) override {
    std::string file = fmt::format("{}-{}-{}", prefix_, images_.size() + 1, name);
    std::replace(file.begin(), file.end(), ' ', '-');
    images_.push_back(page_.drawing(file, image, std::string(name)));
  }
  [[nodiscard]] const std::vector<DemoImage>& images() const { return images_; }

 private:
  DemoPage& page_;
  std::string prefix_;
  std::vector<DemoImage> images_;
};

void add_stages(Context& context, DemoPage& page, const Sample& sample) {
  throw_if_stopped(context.stop);
  StageStrip strip(page, "stage");
  (void)cartoonize(sample.image, options_for(Mode::kCartoon), &strip);
  context.progress->advance();
  page.heading(
      "Processing stages",
      "The stages of the cartoon mode. Lines: greyscale, a median filter against texture, a "
      "Laplacian edge filter, a threshold, removal of single dots. Colour: half the size, fourteen "
      "bilateral filters, full size. The lines are drawn over the colours.");
  page.strip(strip.images());
  page.command(
      fmt::format("tarsier cartoon run {} -o cartoon.png --debug-dir stages", sample.path));
}

// --- the video ---

constexpr int kVideoFrames = 60;

std::vector<Frame> video_frames(const std::string& path, const std::stop_token& stop, double& fps) {
  std::vector<Frame> frames;
  const std::unique_ptr<FrameSource> source = open_source(path, {}, {synth::synth_scheme()});
  fps = source->fps();
  while (static_cast<int>(frames.size()) < kVideoFrames && !source->ended()) {
    throw_if_stopped(stop);
    if (const std::optional<Frame> frame = source->next(std::chrono::milliseconds(500), stop)) {
      frames.push_back(*frame);
      frames.back().image = frame->image.clone();
    }
  }
  return frames;
}

void add_video(Context& context, DemoPage& page) {
  std::string path = sample_image("vtest.avi");
  if (!fs::exists(path)) path = "synth:portrait";
  double fps = 10;
  std::vector<Frame> frames;
  try {
    frames = video_frames(path, context.stop, fps);
  } catch (const InputError& error) {
    log_warning("the demo has no video: {}", error.what());
    return;
  }
  if (frames.size() < 3) return;

  CartoonOptions options = options_for(Mode::kCartoon);
  options.steady.on = true;
  const auto cartoonizer = Cartoonizer::load(ModelStore::find(), options);
  CartoonizerState state;
  std::vector<cv::Mat> images;
  for (const Frame& frame : frames) {
    throw_if_stopped(context.stop);
    images.push_back(cartoonizer.process(frame, state).image);
    context.progress->advance();
  }
  page.heading("Video",
               "The same filters on every frame of a video or camera. --steady prevents flickering "
               "lines in regions without motion.");
  const cv::Mat& poster_frame = images[images.size() / 2];
  const DemoImage poster = page.image("video-poster", poster_frame, "a frame of the video");
  if (write_demo_video(page.path_of("video.mp4"), images, fps > 0 ? fps : 10)) {
    page.video({"img/video.mp4",
                fmt::format("{} frames of {}", images.size(), fs::path(path).filename().string()),
                poster_frame.cols, poster_frame.rows},
               poster);
  } else {
    std::vector<DemoImage> stills;
    for (size_t i = 0; i < images.size(); i += images.size() / 3) {
      stills.push_back(
          page.image(fmt::format("video-{}", i), images[i], fmt::format("frame {}", i)));
    }
    page.grid(stills);
  }
  page.command(fmt::format("tarsier cartoon run {} --steady -o cartoon.mp4", path));
}

// --- speed ---

// Time per frame.
double cartoon_ms(const Frame& frame, const CartoonOptions& options, int repeats) {
  const auto cartoonizer = Cartoonizer::load(ModelStore::find(), options);
  CartoonizerState state;
  return median_ms(repeats, [&] { (void)cartoonizer.process(frame, state); });
}

void add_speed(Context& context, DemoPage& page, const Sample& sample) {
  Frame frame;
  cv::resize(sample.image, frame.image, {640, 480}, 0, 0, cv::INTER_AREA);
  std::vector<std::vector<std::string>> rows;
  for (const Mode mode : cartoon::all_modes()) {
    if (mode == Mode::kNone) continue;
    throw_if_stopped(context.stop);
    CartoonOptions options = options_for(mode);
    options.quality = cartoon::Quality::kReference;
    const double reference = cartoon_ms(frame, options, 3);
    options.quality = cartoon::Quality::kFast;
    const double fast = cartoon_ms(frame, options, 15);
    rows.push_back({std::string(cartoon::name_of(mode)), fmt::format("{:.1f}", reference),
                    fmt::format("{:.2f}", fast), fmt::format("{:.1f}", reference / fast),
                    fmt::format("{:.0f}", 1000 / fast)});
    context.progress->advance();
  }
  page.heading("Speed on this machine",
               "One frame of 640x480 px. The reference computes the filters by plain OpenCV calls. "
               "The fast path is the default and gives the same appearance.");
  page.table({"mode", "reference ms", "fast ms", "speedup", "frames/s"}, rows,
             fmt::format("Medians of this run, {} threads.", cv::getNumThreads()), 4);
  page.command("tarsier bench cartoon");
}

}  // namespace

bool write_demo_video(const std::string& path, const std::vector<cv::Mat>& frames, double fps) {
  AtomicFile file(path);
  const auto writer = lazy_opencv::make_video_writer();
  constexpr int kH264 = 'a' | 'v' << 8 | 'c' << 16 | '1' << 24;
  if (!writer->open(file.path(), kH264, fps, frames.front().size())) return false;
  for (const cv::Mat& frame : frames) writer->write(frame);
  writer->release();
  std::error_code error;
  if (fs::file_size(file.path(), error) < 1000 || error) return false;
  file.commit();
  return true;
}

void demo_cartoon(Context& context, DemoPage& page) {
  const std::vector<Sample> images = samples();
  const auto drawings = static_cast<std::int64_t>(images.size() * std::size(kModes));
  context.progress->begin("cartoon", drawings + 3 + kVideoFrames + 7, "images");
  page.begin_area("Cartoon",
                  "Images, videos and live cameras are converted to cartoons, in real time on a "
                  "small machine.");
  add_samples(context, page, images);
  add_faces(context, page);
  add_stages(context, page, images.front());
  add_video(context, page);
  add_speed(context, page, images.front());
  context.progress->end();
}

}  // namespace tarsier::cli
