#include "service/trace/spans.h"

#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <exception>
#include <stdexcept>
#include <utility>

#include "service/limits/require_between.h"
#include "service/limits/seconds.h"

namespace teletact::service {
namespace {

Span::Time::duration checked(const char* option, double slow_s) {
  require_between(option, slow_s, 0.0, Spans::kMostSlowS, "give seconds");
  return seconds(slow_s);
}

// Linux gives each thread its own nice value.
void write_below_touch() {
  constexpr int kNiceness = 10;
  if (setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNiceness) != 0)
    spdlog::warn("event=niceness_refused errno={}", errno);
}

}  // namespace

std::unique_ptr<Spans> Spans::make(const SpansOptions& options, SpanSource source) {
  if (!options.file.empty()) return std::unique_ptr<Spans>(new Spans(options, std::move(source)));
  for (const auto& [option, given] :
       {std::pair{"--slow-call-s", options.slow_call_s}, {"--slow-answer-s", options.slow_answer_s}})
    if (given)
      throw std::runtime_error(std::string(option) +
                               ": slow ones are written to --spans-file; give that, too");
  return nullptr;
}

Spans::Spans(const SpansOptions& options, SpanSource source)
    : slow_call_(checked("--slow-call-s", options.slow_call_s.value_or(kSlowCallS))),
      slow_answer_(checked("--slow-answer-s", options.slow_answer_s.value_or(kSlowAnswerS))),
      source_(std::move(source)),
      file_(options.file, kMostFileBytes) {
  waiting_.reserve(kMostWaiting);
  thread_ = std::thread([this] { work(); });
}

Spans::~Spans() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  stopped_.notify_all();
  thread_.join();
}

// There is room: who tells holds the lock for a move, and the writer for a swap.
void Spans::put(Span span) {
  const std::lock_guard lock(mutex_);
  if (waiting_.size() < kMostWaiting)
    waiting_.push_back(std::move(span));
  else
    ++dropped_;
}

void Spans::work() {
  write_below_touch();
  std::vector<Span> taken;
  taken.reserve(kMostWaiting);
  for (bool last = false; !last;) {
    {
      std::unique_lock lock(mutex_);
      last = stopped_.wait_for(lock, kWriteEvery, [this] { return stop_; });
      taken.swap(waiting_);
    }
    const std::chrono::nanoseconds to_wall =
        std::chrono::system_clock::now().time_since_epoch() - Clock::now().time_since_epoch();
    std::size_t k = 0;
    while (k < taken.size() && write(taken[k], to_wall)) ++k;
    dropped_ += taken.size() - k;  // the disk is tried again with the next ones
    taken.clear();
  }
}

bool Spans::write(const Span& span, std::chrono::nanoseconds to_wall) {
  try {
    file_.append(otlp_line(span, source_, to_wall));
  } catch (const std::exception& error) {
    const auto now = Clock::now();
    if (said_ || (said_at_ && now - *said_at_ < kSayEvery)) return false;
    said_ = true, said_at_ = now;
    spdlog::error("event=spans_not_written error=\"{}\" until=\"the disk takes them: free space\"",
                  error.what());
    return false;
  }
  ++written_;
  if (std::exchange(said_, false)) spdlog::info("event=spans_written_again dropped={}", dropped());
  return true;
}

}  // namespace teletact::service
