// A source of pairs, some of which are spoiled on purpose: to see what the service makes of them.
#pragma once

#include <memory>
#include <string>

#include "client/acquire/frame_source.h"
#include "common/file_descriptor.h"

namespace teletact::client {

class SpoiledSource : public FrameSource {
 public:
  // `pipe`: a named pipe; each line spoils the next pair. "force": the sensor says three times what it felt;
  // "decorrelated": the post frame is of other tissue. Throws std::runtime_error when it cannot be read.
  SpoiledSource(std::unique_ptr<FrameSource> source, const std::string& pipe);

  std::size_t window_count() const override { return source_->window_count(); }
  double window_width_m() const override { return source_->window_width_m(); }
  double compression_m() const override { return source_->compression_m(); }
  std::size_t frames_left(std::size_t window) const override { return source_->frames_left(window); }
  FramePair take(std::size_t window) override;

 private:
  std::unique_ptr<FrameSource> source_;
  FileDescriptor pipe_;
  std::string said_;  // lines that wait
};

}  // namespace teletact::client
