// The listener against peers that do as they like: it answers the others, and holds no more than it states.
#include "service/operation/http_listener.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/operation/http_peer.h"

namespace teletact::service {
namespace {

using test::HttpPeer;

HttpListener::Answer echo(const std::string& path) {
  if (path == "/throws") throw std::runtime_error("it broke");
  if (path == "/long") return {200, std::string(1 << 24, 'x')};
  return path == "/there" ? HttpListener::Answer{200, "yes\n"} : HttpListener::Answer{404, "no\n"};
}

struct Listening {
  explicit Listening(double patience_s = HttpListener::kPatienceS)
      : listener("--admin", "127.0.0.1:0", echo, patience_s) {}
  HttpListener listener;
  unsigned port = test::port_of(listener.address());
  std::string get(const std::string& target) const { return test::http_get(port, target); }
};

TEST(HttpListener, AnswersOneGetAConnection) {
  const Listening l;
  const std::string yes = l.get("/there?with=query");
  EXPECT_TRUE(yes.starts_with("HTTP/1.1 200")) << yes;
  EXPECT_TRUE(yes.ends_with("\r\n\r\nyes\n")) << yes;
  EXPECT_NE(yes.find("Connection: close"), std::string::npos) << yes;
  EXPECT_TRUE(l.get("/elsewhere").starts_with("HTTP/1.1 404"));
  EXPECT_TRUE(l.get("/throws").starts_with("HTTP/1.1 500"));
  EXPECT_EQ(l.get("/long").size(), (1u << 24) + l.get("/long").find("\r\n\r\n") + 4) << "whole";
  HttpPeer head(l.port), post(l.port);
  head.send("HEAD /there HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const std::string nothing = head.rest();
  EXPECT_TRUE(nothing.starts_with("HTTP/1.1 200") && nothing.ends_with("\r\n\r\n")) << nothing;
  post.send("POST /there HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n");
  EXPECT_TRUE(post.rest().starts_with("HTTP/1.1 405"));
}

TEST(HttpListener, AnotherSitesPageIsToldNothing) {
  const Listening l;
  for (const char* host : {"evil.example", "evil.example:80", "127.0.0.1.evil.example", "192.0.2.1"}) {
    HttpPeer peer(l.port);
    peer.send("GET /there HTTP/1.1\r\nHost: " + std::string(host) + "\r\n\r\n");
    EXPECT_TRUE(peer.rest().starts_with("HTTP/1.1 403")) << host;
  }
  for (const char* headers :
       {"", "Host: 127.0.0.1\r\nHost: evil.example\r\n", "Host: evil.example\r\nHost: 127.0.0.1\r\n",
        "Host: localhost\r\nHost: localhost\r\n"}) {
    HttpPeer peer(l.port);
    peer.send("GET /there HTTP/1.1\r\n" + std::string(headers) + "\r\n");
    EXPECT_TRUE(peer.rest().starts_with("HTTP/1.1 400")) << headers;
  }
  for (const char* headers :
       {"Host: 127.0.0.1:9464\r\n", "Host: localhost\r\n", "Host: [::1]:9464\r\n", ""}) {
    HttpPeer peer(l.port);
    peer.send("GET /there HTTP/1.0\r\n" + std::string(headers) + "\r\n");
    EXPECT_TRUE(peer.rest().starts_with("HTTP/1.1 200")) << headers;
  }
}

TEST(HttpListener, OnAUnixSocketToo) {
  const std::string path = "/tmp/tt-admin-" + std::to_string(getpid());
  {
    const HttpListener listener("--admin", "unix:" + path, echo);
    HttpPeer peer(path);
    peer.send("GET /there HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_TRUE(peer.rest().starts_with("HTTP/1.1 200"));
    EXPECT_THROW(HttpListener("--admin", "unix:" + path, echo), std::runtime_error) << "it is served";
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(HttpListener, OnlyThisMachineIsListenedTo) {
  for (const char* address : {"0.0.0.0:0", "[::]:0", "192.0.2.1:80", "example.org:80", "9090", ":9090",
                              "127.0.0.1", "127.0.0.1:65536", "127.0.0.1:http", "unix:", ""})
    try {
      HttpListener("--admin", address, echo);
      ADD_FAILURE() << address;
    } catch (const std::runtime_error& error) {
      EXPECT_TRUE(std::string(error.what()).starts_with(std::string("--admin ") + address + ": "))
          << error.what();
    }
  const Listening l;
  EXPECT_THROW(HttpListener("--admin", l.listener.address(), echo), std::runtime_error) << "in use";
}

TEST(HttpListener, WhatIsNoRequestIsCut) {
  const Listening l;
  for (const std::string& nonsense :
       {std::string("\0\xff\x16\x03\x01", 5) + "\r\n\r\n", std::string("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"),
        "GET /" + std::string(1 << 16, 'a') + " HTTP/1.1\r\n\r\n",
        "GET /there HTTP/1.1\r\nX: " + std::string(1 << 16, 'b') + "\r\n\r\n",
        std::string("GET /there HTTP/1.1\r\nno colon\r\n\r\n"), std::string("\r\n\r\n\r\n")}) {
    HttpPeer peer(l.port);
    peer.send(nonsense);
    peer.close_sending();
    EXPECT_FALSE(peer.rest().starts_with("HTTP/1.1 200")) << nonsense.substr(0, 30);
  }
  EXPECT_TRUE(l.get("/there").starts_with("HTTP/1.1 200"));
}

// As many as it takes, that ask and do not read: none is kept longer than stated, and whoever asks meanwhile
// waits for that, no longer.
TEST(HttpListener, PeersThatHoldConnectionsAreCutAndOthersAnswered) {
  constexpr double kPatienceS = 0.25;
  const Listening l(kPatienceS);
  std::vector<HttpPeer> slow;
  const auto begin = std::chrono::steady_clock::now();
  for (std::size_t k = 0; k < HttpListener::kMaxConnections; ++k) {
    slow.emplace_back(l.port);
    slow.back().send("GET /long HTTP/1.1\r\nHost: localhost\r\n\r\n");
  }
  EXPECT_TRUE(l.get("/there").starts_with("HTTP/1.1 200"));
  const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - begin;
  EXPECT_GT(waited.count(), 0.5 * kPatienceS) << "they held nothing";
}

// GIVEN as many that have asked as may be open WHEN another asks THEN it is answered once one of them goes.
TEST(HttpListener, NoMoreThanMayAreOpenAtOnce) {
  constexpr double kForEver = 3600;
  const Listening l(kForEver);
  std::vector<HttpPeer> slow;
  for (std::size_t k = 0; k < HttpListener::kMaxConnections; ++k) {
    slow.emplace_back(l.port);
    slow.back().send("GET /long HTTP/1.1\r\nHost: localhost\r\n\r\n");
    ASSERT_TRUE(slow.back().answered_within(60'000));
  }
  HttpPeer next(l.port);
  next.send("GET /there HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_FALSE(next.answered_within(50));
  slow.pop_back();
  EXPECT_TRUE(next.rest().starts_with("HTTP/1.1 200"));
}

// Nobody waits for those that have not asked yet, however many come and however slowly they speak.
TEST(HttpListener, ConnectionsThatHaveNotAskedGiveWay) {
  constexpr double kForEver = 3600;
  const Listening l(kForEver);
  std::vector<HttpPeer> idle;
  for (int k = 0; k < 1000; ++k) {
    idle.emplace_back(l.port);
    if (k % 2 == 0) idle.back().send("GET /there HTTP/1.1\r\nX-Long: ");
    if (k % 100 != 0) continue;  // fewer than the system's queue takes
    EXPECT_TRUE(l.get("/there").starts_with("HTTP/1.1 200")) << k;
  }
  EXPECT_TRUE(l.get("/there").starts_with("HTTP/1.1 200"));
}

TEST(HttpListener, ManyConnectionsLeaveNothing) {
  const auto files = [] {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"),
                         std::filesystem::directory_iterator());
  };
  const auto before = files();
  {
    const Listening l;
    for (int k = 0; k < 500; ++k) {
      HttpPeer peer(l.port);  // goes without a word
      if (k % 10 > 0) continue;
      EXPECT_TRUE(l.get("/there").starts_with("HTTP/1.1 200")) << k;
    }
    const HttpPeer still_there(l.port);
  }
  EXPECT_EQ(files(), before);
}

}  // namespace
}  // namespace teletact::service
