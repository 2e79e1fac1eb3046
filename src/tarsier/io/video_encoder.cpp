// SPDX-License-Identifier: MIT
#include "tarsier/io/video_encoder.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
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
#include <libavutil/rational.h>
#include <libswscale/swscale.h>
}

namespace tarsier {
namespace {

constexpr int kQuantizer = 3;        // of 1..31; 2 is the finest that pays
constexpr int kKeyFrameEvery = 12;   // frames, where nothing else asks for it
constexpr int kMaxTimeBase = 60000;  // MPEG-4 has 16 bits for it

std::string error_text(int code) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  av_strerror(code, text.data(), text.size());
  return text.data();
}

template <typename T>
T* not_null(T* pointer) {
  if (pointer == nullptr) throw std::bad_alloc();
  return pointer;
}

}  // namespace

struct VideoEncoder::Impl {
  explicit Impl(std::string the_shown) : shown(std::move(the_shown)) {}
  ~Impl() {
    sws_freeContext(scaler);
    av_packet_free(&packet);
    av_frame_free(&frame);
    avcodec_free_context(&codec);
    if (muxer != nullptr) {
      avio_closep(&muxer->pb);
      avformat_free_context(muxer);
    }
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void open(const std::string& path, cv::Size size, const VideoEncoderOptions& options);
  void encode(const AVFrame* picture);
  void check(int code, std::string_view doing) const {
    if (code < 0) throw OutputError(shown, fmt::format("{}: {}", doing, error_text(code)));
  }
  // What could not be written may only be known to the file.
  void check_file() const { check(muxer->pb->error, "cannot write"); }

  std::string shown;
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
  const bool is_avi = options.ending == ".avi";
  const char* format = is_avi ? "avi" : options.ending == ".mp4" ? "mp4" : "matroska";
  check(avformat_alloc_output_context2(&muxer, nullptr, format, nullptr), "cannot make a video");
  const AVCodec* encoder = avcodec_find_encoder(is_avi ? AV_CODEC_ID_MJPEG : AV_CODEC_ID_MPEG4);
  if (encoder == nullptr) throw OutputError(shown, "this system's FFmpeg has no encoder for it");
  muxer->flags |= AVFMT_FLAG_BITEXACT;  // no random numbers, no versions
  stream = not_null(avformat_new_stream(muxer, nullptr));
  codec = not_null(avcodec_alloc_context3(encoder));
  const AVRational rate = av_d2q(options.fps, kMaxTimeBase);
  codec->width = size.width;
  codec->height = size.height;
  codec->pix_fmt = AV_PIX_FMT_YUV420P;
  codec->color_range = is_avi ? AVCOL_RANGE_JPEG : AVCOL_RANGE_UNSPECIFIED;
  codec->time_base = av_inv_q(rate);
  codec->framerate = rate;
  codec->gop_size = options.cut_safe
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
  check(avcodec_open2(codec, encoder, nullptr), doing);
  check(avcodec_parameters_from_context(stream->codecpar, codec), doing);
  stream->time_base = codec->time_base;
  stream->avg_frame_rate = rate;

  frame = not_null(av_frame_alloc());
  frame->width = size.width;
  frame->height = size.height;
  frame->format = codec->pix_fmt;
  frame->color_range = codec->color_range;
  check(av_frame_get_buffer(frame, 0), doing);
  packet = not_null(av_packet_alloc());
  // JPEGs have the full range of grey; asked for by the name of the format, since a range that is
  // set later does not reach the fast conversion.
  scaler = not_null(sws_getContext(size.width, size.height, AV_PIX_FMT_BGR24, size.width,
                                   size.height, is_avi ? AV_PIX_FMT_YUVJ420P : codec->pix_fmt,
                                   SWS_BICUBIC, nullptr, nullptr, nullptr));

  // "file:" and absolute: FFmpeg takes "a:b.mp4" for a protocol.
  const std::string url = "file:" + std::filesystem::absolute(path).string();
  check(avio_open(&muxer->pb, url.c_str(), AVIO_FLAG_WRITE), "cannot write");
  AVDictionary* settings = nullptr;
  if (options.cut_safe) {
    muxer->flags |= AVFMT_FLAG_FLUSH_PACKETS;
    if (options.ending == ".mp4") {
      av_dict_set(&settings, "movflags", "frag_keyframe+empty_moov+default_base_moof", 0);
    } else if (!is_avi) {
      av_dict_set(&settings, "cluster_time_limit", "1000", 0);  // ms
    }
  }
  const int code = avformat_write_header(muxer, &settings);
  av_dict_free(&settings);
  check(code, doing);
  check_file();
}

// Nothing: what the encoder still holds.
void VideoEncoder::Impl::encode(const AVFrame* picture) {
  check(avcodec_send_frame(codec, picture), "cannot encode");
  while (true) {
    const int code = avcodec_receive_packet(codec, packet);
    if (code == AVERROR(EAGAIN) || code == AVERROR_EOF) break;
    check(code, "cannot encode");
    packet->duration = 1;
    packet->stream_index = stream->index;
    av_packet_rescale_ts(packet, codec->time_base, stream->time_base);
    check(av_write_frame(muxer, packet), "cannot write");
    av_packet_unref(packet);
  }
  check_file();
}

VideoEncoder::VideoEncoder(const std::string& path, const std::string& shown, cv::Size size,
                           const VideoEncoderOptions& options)
    : impl_(std::make_unique<Impl>(shown)) {
  TARSIER_REQUIRE(size.width > 0 && size.height > 0 && size.width % 2 == 0 && size.height % 2 == 0,
                  "{}x{} px", size.width, size.height);
  TARSIER_REQUIRE(options.fps > 0 && options.fps <= 1000, "fps {}", options.fps);
  TARSIER_REQUIRE(options.ending == ".mp4" || options.ending == ".avi" || options.ending == ".mkv",
                  "ending '{}'", options.ending);
  av_log_set_level(AV_LOG_QUIET);  // what is wrong is returned, and said once
  impl_->open(path, size, options);
}

VideoEncoder::~VideoEncoder() = default;

void VideoEncoder::write(const cv::Mat& bgr) {
  AVFrame* frame = impl_->frame;
  TARSIER_REQUIRE(bgr.type() == CV_8UC3 && bgr.cols == frame->width && bgr.rows == frame->height,
                  "{}x{}, type {}", bgr.cols, bgr.rows, bgr.type());
  impl_->check(av_frame_make_writable(frame), "cannot encode");
  const std::uint8_t* const source[] = {bgr.data};
  const int step[] = {static_cast<int>(bgr.step[0])};
  sws_scale(impl_->scaler, source, step, 0, bgr.rows, frame->data, frame->linesize);
  frame->pts = impl_->count++;
  frame->quality = impl_->codec->global_quality;
  impl_->encode(frame);
}

void VideoEncoder::finish() {
  impl_->encode(nullptr);
  impl_->check(av_write_trailer(impl_->muxer), "cannot write");
  avio_flush(impl_->muxer->pb);
  impl_->check_file();
  impl_->check(avio_closep(&impl_->muxer->pb), "cannot write");
}

}  // namespace tarsier
