// A small HTTP server of this machine, for probes and scrapes: GET alone, one answer a connection, one thread
// below touch. A peer that sends slowly, or too much, or does not read, is cut; while as many are connected
// as are served at once, others wait in the system's queue.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace teletact::service {

class HttpListener {
 public:
  static constexpr std::size_t kMaxConnections = 8, kMaxHeadBytes = 8192;
  static constexpr double kPatienceS = 5;  // for the whole request, and for the answer to be taken

  struct Answer {
    unsigned status = 200;
    std::string text;
    const char* type = "text/plain; charset=utf-8";
  };
  // Of a GET for `path`, which has no query: status 404 for one that is not known. On the listener's thread.
  using Answers = std::function<Answer(const std::string& path)>;

  // `flag`: what `address` was given by, for what is said of it: HOST:PORT of this machine, or unix:/path.
  // Throws std::runtime_error, one line: any other address, or one that cannot be listened on.
  HttpListener(const char* flag, const std::string& address, Answers, double patience_s = kPatienceS);
  ~HttpListener();
  HttpListener(const HttpListener&) = delete;
  HttpListener& operator=(const HttpListener&) = delete;

  const std::string& address() const { return address_; }  // with the port in use

 private:
  struct State;
  std::string address_;
  std::unique_ptr<State> state_;
};

}  // namespace teletact::service
