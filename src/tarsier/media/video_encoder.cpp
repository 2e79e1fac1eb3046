// SPDX-License-Identifier: MIT
#include "tarsier/media/video_encoder.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <dlfcn.h>
#include <filesystem>
#include <new>
#include <string_view>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/dict.h>
#include <libavutil/error.h>
#include <libavutil/frame.h>
#include <libavutil/log.h>
#include <libavutil/macros.h>
#include <libavutil/rational.h>
#include <libswscale/swscale.h>
}

namespace tarsier {
namespace {

// The FFmpeg functions in use. The libraries are loaded with the first video: with all their
// dependencies, linking them takes as long as the rest of a program that writes no video
// (lazy_opencv.h).
class Ffmpeg {
 private:
  // Never unloaded: the same libraries may read videos.
  static void* load(const char* library) {
    void* handle = dlopen(library, RTLD_LAZY | RTLD_LOCAL);
    if (handle == nullptr) {
      const char* reason = dlerror();
      throw Error(ErrorKind::kOutput, fmt::format("cannot load FFmpeg's {}; install it",
                                                  reason == nullptr ? library : reason));
    }
    return handle;
  }
  template <typename Function>
  static Function find(void* library, const char* name) {
    void* address = dlsym(library, name);
    if (address == nullptr)
      throw Error(ErrorKind::kOutput, fmt::format("FFmpeg's libraries lack {}", name));
    return reinterpret_cast<Function>(address);
  }

  void* const avformat_ = load("libavformat.so." AV_STRINGIFY(LIBAVFORMAT_VERSION_MAJOR));
  void* const avcodec_ = load("libavcodec.so." AV_STRINGIFY(LIBAVCODEC_VERSION_MAJOR));
  void* const swscale_ = load("libswscale.so." AV_STRINGIFY(LIBSWSCALE_VERSION_MAJOR));
  void* const avutil_ = load("libavutil.so." AV_STRINGIFY(LIBAVUTIL_VERSION_MAJOR));

 public:
#define TARSIER_FIND(library, name) \
  decltype(&::name) const name = find<decltype(&::name)>(library, #name)
  TARSIER_FIND(avformat_, avformat_alloc_output_context2);
  TARSIER_FIND(avformat_, avformat_free_context);
  TARSIER_FIND(avformat_, avformat_new_stream);
  TARSIER_FIND(avformat_, avformat_write_header);
  TARSIER_FIND(avformat_, av_write_frame);
  TARSIER_FIND(avformat_, av_write_trailer);
  TARSIER_FIND(avformat_, avio_open);
  TARSIER_FIND(avformat_, avio_flush);
  TARSIER_FIND(avformat_, avio_closep);
  TARSIER_FIND(avcodec_, avcodec_alloc_context3);
  TARSIER_FIND(avcodec_, avcodec_find_encoder);
  TARSIER_FIND(avcodec_, avcodec_free_context);
  TARSIER_FIND(avcodec_, avcodec_open2);
  TARSIER_FIND(avcodec_, avcodec_parameters_from_context);
  TARSIER_FIND(avcodec_, avcodec_receive_packet);
  TARSIER_FIND(avcodec_, avcodec_send_frame);
  TARSIER_FIND(avcodec_, av_packet_alloc);
  TARSIER_FIND(avcodec_, av_packet_free);
  TARSIER_FIND(avcodec_, av_packet_rescale_ts);
  TARSIER_FIND(avcodec_, av_packet_unref);
  TARSIER_FIND(swscale_, sws_freeContext);
  TARSIER_FIND(swscale_, sws_getContext);
  TARSIER_FIND(swscale_, sws_scale);
  TARSIER_FIND(avutil_, av_d2q);
  TARSIER_FIND(avutil_, av_dict_free);
  TARSIER_FIND(avutil_, av_dict_set);
  TARSIER_FIND(avutil_, av_frame_alloc);
  TARSIER_FIND(avutil_, av_frame_free);
  TARSIER_FIND(avutil_, av_frame_get_buffer);
  TARSIER_FIND(avutil_, av_frame_make_writable);
  TARSIER_FIND(avutil_, av_log_set_level);
  TARSIER_FIND(avutil_, av_strerror);
#undef TARSIER_FIND
};

const Ffmpeg& ffmpeg() {
  static const Ffmpeg kLoaded;
  return kLoaded;
}

constexpr int kQuantizer = 3;        // of 1..31; finer than 2 does not help
constexpr int kKeyFrameEvery = 12;   // frames, unless a key frame is needed earlier
constexpr int kMaxTimeBase = 60000;  // MPEG-4 has 16 bits for it

std::string error_text(int code) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  ffmpeg().av_strerror(code, text.data(), text.size());
  return text.data();
}

template <typename T>
T* not_null(T* pointer) {
  if (pointer == nullptr) throw std::bad_alloc();
  return pointer;
}

}  // namespace

struct VideoEncoder::Impl {
  // Loads FFmpeg first, so that the destructor finds it loaded.
  explicit Impl(std::string path_for_messages) : display_path(std::move(path_for_messages)) {
    static_cast<void>(ffmpeg());
  }
  ~Impl() {
    ffmpeg().sws_freeContext(scaler);
    ffmpeg().av_packet_free(&packet);
    ffmpeg().av_frame_free(&frame);
    ffmpeg().avcodec_free_context(&codec);
    if (muxer != nullptr) {
      ffmpeg().avio_closep(&muxer->pb);
      ffmpeg().avformat_free_context(muxer);
    }
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void open(const std::string& path, cv::Size size, const VideoEncoderOptions& options);
  void encode(const AVFrame* image) const;
  void check(int code, std::string_view doing) const {
    if (code < 0) throw OutputError(display_path, fmt::format("{}: {}", doing, error_text(code)));
  }
  // Some write errors are only known to the file.
  void check_file() const { check(muxer->pb->error, "cannot write"); }

  std::string display_path;
  AVFormatContext* muxer = nullptr;
  AVStream* stream = nullptr;
  AVCodecContext* codec = nullptr;
  AVFrame* frame = nullptr;
  AVPacket* packet = nullptr;
  SwsContext* scaler = nullptr;
  std::int64_t count = 0;
};

void VideoEncoder::Impl::open(const std::string& path, cv::Size size,
                              const VideoEncoderOptions& options) {
  const bool is_avi = options.extension == ".avi";
  const char* format = is_avi ? "avi" : options.extension == ".mp4" ? "mp4" : "matroska";
  check(ffmpeg().avformat_alloc_output_context2(&muxer, nullptr, format, nullptr),
        "cannot make a video");
  const AVCodec* encoder =
      ffmpeg().avcodec_find_encoder(is_avi ? AV_CODEC_ID_MJPEG : AV_CODEC_ID_MPEG4);
  if (encoder == nullptr)
    throw OutputError(display_path, "this system's FFmpeg has no encoder for it");
  muxer->flags |= AVFMT_FLAG_BITEXACT;  // no random numbers, no versions
  stream = not_null(ffmpeg().avformat_new_stream(muxer, nullptr));
  codec = not_null(ffmpeg().avcodec_alloc_context3(encoder));
  const AVRational rate = ffmpeg().av_d2q(options.fps, kMaxTimeBase);
  codec->width = size.width;
  codec->height = size.height;
  codec->pix_fmt = AV_PIX_FMT_YUV420P;
  codec->color_range = is_avi ? AVCOL_RANGE_JPEG : AVCOL_RANGE_UNSPECIFIED;
  codec->time_base = av_inv_q(rate);
  codec->framerate = rate;
  codec->gop_size = options.crash_safe
                        ? std::clamp(static_cast<int>(std::lround(options.fps)), 1, 600)
                        : kKeyFrameEvery;
  codec->max_b_frames = 0;
  codec->thread_count = 1;
  codec->flags |= AV_CODEC_FLAG_QSCALE | AV_CODEC_FLAG_BITEXACT;
  codec->global_quality = kQuantizer * FF_QP2LAMBDA;
  if ((muxer->oformat->flags & AVFMT_GLOBALHEADER) != 0)
    codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  const std::string doing = fmt::format("cannot encode {}x{} video at {:g} frames per second",
                                        size.width, size.height, options.fps);
  check(ffmpeg().avcodec_open2(codec, encoder, nullptr), doing);
  check(ffmpeg().avcodec_parameters_from_context(stream->codecpar, codec), doing);
  stream->time_base = codec->time_base;
  stream->avg_frame_rate = rate;

  frame = not_null(ffmpeg().av_frame_alloc());
  frame->width = size.width;
  frame->height = size.height;
  frame->format = codec->pix_fmt;
  frame->color_range = codec->color_range;
  check(ffmpeg().av_frame_get_buffer(frame, 0), doing);
  packet = not_null(ffmpeg().av_packet_alloc());
  // JPEGs use the full range. The range is requested by the name of the format, because a range
  // that is set later does not reach the fast conversion.
  scaler = not_null(ffmpeg().sws_getContext(
      size.width, size.height, AV_PIX_FMT_BGR24, size.width, size.height,
      is_avi ? AV_PIX_FMT_YUVJ420P : codec->pix_fmt, SWS_BICUBIC, nullptr, nullptr, nullptr));

  // "file:" and an absolute path, because FFmpeg takes "a:b.mp4" for a protocol.
  const std::string url = "file:" + std::filesystem::absolute(path).string();
  check(ffmpeg().avio_open(&muxer->pb, url.c_str(), AVIO_FLAG_WRITE), "cannot write");
  AVDictionary* settings = nullptr;
  if (options.crash_safe) {
    muxer->flags |= AVFMT_FLAG_FLUSH_PACKETS;
    if (options.extension == ".mp4") {
      ffmpeg().av_dict_set(&settings, "movflags", "frag_keyframe+empty_moov+default_base_moof", 0);
    } else if (!is_avi) {
      ffmpeg().av_dict_set(&settings, "cluster_time_limit", "1000", 0);  // ms
    }
  }
  const int code = ffmpeg().avformat_write_header(muxer, &settings);
  ffmpeg().av_dict_free(&settings);
  check(code, doing);
  check_file();
}

// Without an image: flushes the encoder.
void VideoEncoder::Impl::encode(const AVFrame* image) const {
  check(ffmpeg().avcodec_send_frame(codec, image), "cannot encode");
  while (true) {
    const int code = ffmpeg().avcodec_receive_packet(codec, packet);
    if (code == AVERROR(EAGAIN) || code == AVERROR_EOF) break;
    check(code, "cannot encode");
    packet->duration = 1;
    packet->stream_index = stream->index;
    ffmpeg().av_packet_rescale_ts(packet, codec->time_base, stream->time_base);
    check(ffmpeg().av_write_frame(muxer, packet), "cannot write");
    ffmpeg().av_packet_unref(packet);
  }
  check_file();
}

void VideoEncoderOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(extension == ".mp4" || extension == ".avi" || extension == ".mkv", "ending '{}'",
                  extension);
}

VideoEncoder::VideoEncoder(const std::string& path, const std::string& display_path, cv::Size size,
                           const VideoEncoderOptions& options)
    : impl_(std::make_unique<Impl>(display_path)) {
  TARSIER_REQUIRE(size.width > 0 && size.height > 0 && size.width % 2 == 0 && size.height % 2 == 0,
                  "{}x{} px", size.width, size.height);
  options.check();
  ffmpeg().av_log_set_level(AV_LOG_QUIET);  // errors are returned and reported once
  impl_->open(path, size, options);
}

VideoEncoder::~VideoEncoder() = default;

void VideoEncoder::write(const cv::Mat& bgr) {
  AVFrame* frame = impl_->frame;
  TARSIER_REQUIRE(bgr.type() == CV_8UC3 && bgr.cols == frame->width && bgr.rows == frame->height,
                  "{}x{}, type {}", bgr.cols, bgr.rows, bgr.type());
  impl_->check(ffmpeg().av_frame_make_writable(frame), "cannot encode");
  const std::uint8_t* const source[] = {bgr.data};
  const int step[] = {static_cast<int>(bgr.step[0])};
  ffmpeg().sws_scale(impl_->scaler, source, step, 0, bgr.rows, frame->data, frame->linesize);
  frame->pts = impl_->count++;
  frame->quality = impl_->codec->global_quality;
  impl_->encode(frame);
}

void VideoEncoder::finish() {
  impl_->encode(nullptr);
  impl_->check(ffmpeg().av_write_trailer(impl_->muxer), "cannot write");
  ffmpeg().avio_flush(impl_->muxer->pb);
  impl_->check_file();
  impl_->check(ffmpeg().avio_closep(&impl_->muxer->pb), "cannot write");
}

}  // namespace tarsier
