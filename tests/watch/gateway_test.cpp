// The page's gateway against browsers and what is none: who is let in, and what each gets.
#include "client/watch/gateway.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "tests/operation/http_peer.h"
#include "tests/watch/web_peer.h"

namespace teletact::client {
namespace {

using test::HttpPeer;
using test::WebFrame;
using test::WebPeer;

constexpr auto kTrace = static_cast<std::uint32_t>(Channel::kTrace);
constexpr auto kMap = static_cast<std::uint32_t>(Channel::kMap);
constexpr auto kScene = static_cast<std::uint32_t>(Channel::kScene);

struct Watched {
  View view;
  std::vector<nlohmann::json> orders;
  Gateway gateway{0, view, [this](const nlohmann::json& order) { orders.push_back(order); }};
  std::int64_t time_ns = 1'000'000'000;

  void ticks(int count) {
    for (int n = 0; n < count; ++n) {
      v1::RecordEntry entry;
      entry.set_monotonic_ns(time_ns += 1'000'000);
      entry.mutable_servo()->add_position_m(1e-9 * static_cast<double>(time_ns));
      entry.mutable_servo()->set_state(1);
      view.take(entry);
    }
  }
  std::string answer(const std::string& request) const {
    HttpPeer peer(test::port_of_url(gateway.url()));
    peer.send(request);
    return peer.rest();
  }
  std::string get(const std::string& path, const std::string& host = "127.0.0.1:1") const {
    return answer("GET " + path + " HTTP/1.1\r\nHost: " + host + "\r\n\r\n");
  }
  std::string path(const std::string& name = "") const { return test::path_of_url(gateway.url()) + name; }
};

template <class Met>
bool within(double seconds, Met&& met) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!met()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

v1::Scene scene_of(std::uint64_t version, unsigned nx, unsigned ny) {
  v1::Scene scene;
  scene.set_scene_id("s");
  scene.set_version(version);
  v1::Map& map = *scene.mutable_youngs_modulus();
  map.mutable_grid()->add_size(nx);
  map.mutable_grid()->add_size(ny);
  for (int axis = 0; axis < 2; ++axis)
    map.mutable_grid()->add_origin_m(0.0005), map.mutable_grid()->add_spacing_m(0.001);
  const std::vector<float> values(std::size_t{nx} * ny, 5e3F);
  map.mutable_values()->set_dtype(v1::DATA_TYPE_FLOAT32);
  map.mutable_values()->set_data(values.data(), values.size() * sizeof(float));
  return scene;
}

TEST(Gateway, GivesThePageOnlyToWhoHasTheToken) {
  const Watched w;
  const std::string page = w.get(w.path());
  EXPECT_TRUE(page.starts_with("HTTP/1.1 200")) << page.substr(0, 300);
  EXPECT_NE(page.find("Content-Security-Policy: default-src 'none'; script-src 'self'"), std::string::npos);
  EXPECT_EQ(page.find("unsafe"), std::string::npos);
  EXPECT_EQ(page.find("http", page.find("<!doctype")), std::string::npos) << "nothing comes from elsewhere";
  std::size_t bytes = 0;
  for (const char* name : {"", "style.css", "app.js", "decode.js", "draw.js", "layout.js", "panels.js",
                           "series.js", "tissue.js"}) {
    const std::string file = w.get(w.path(name));
    EXPECT_TRUE(file.starts_with("HTTP/1.1 200")) << name;
    bytes += file.size();
  }
  EXPECT_LE(bytes, 100'000u);
  EXPECT_TRUE(w.get(w.path("../secret")).starts_with("HTTP/1.1 404"));
  EXPECT_TRUE(w.get(w.path("live")).starts_with("HTTP/1.1 400")) << "no WebSocket";
  EXPECT_TRUE(w.answer("POST " + w.path() + " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n")
                  .starts_with("HTTP/1.1 405"));
}

TEST(Gateway, AnAddressWithoutItsLastSlashLeadsToThePage) {
  const Watched w;
  const std::string path = w.path(), without = path.substr(0, path.size() - 1);
  for (const std::string& asked : {without, without + "?x=1"}) {
    const std::string answer = w.get(asked);
    EXPECT_TRUE(answer.starts_with("HTTP/1.1 308")) << answer;
    EXPECT_NE(answer.find("Location: " + path + "\r\n"), std::string::npos) << answer;
    EXPECT_NE(answer.find("Content-Security-Policy"), std::string::npos) << answer;
  }
  for (const std::string& wrong : {without + "0", without.substr(0, without.size() - 1), "/" + without})
    EXPECT_TRUE(w.get(wrong).starts_with("HTTP/1.1 403")) << wrong;
  EXPECT_TRUE(w.get(without, "example.org").starts_with("HTTP/1.1 403"));
}

TEST(Gateway, RefusesAWrongTokenAForeignHostAndAForeignOrigin) {
  const Watched w;
  for (const char* path : {"/", "/x", "/00000000000000000000000000000000/", "//"})
    EXPECT_TRUE(w.get(path).starts_with("HTTP/1.1 403")) << path;
  for (const char* host : {"example.org", "127.0.0.1.example.org", "127.0.0.1@example.org", ""})
    EXPECT_TRUE(w.get(w.path(), host).starts_with("HTTP/1.1 403")) << host;
  for (const char* host : {"localhost:9", "127.0.0.1", "[::1]:80"})
    EXPECT_TRUE(w.get(w.path(), host).starts_with("HTTP/1.1 200")) << host;
  for (const char* hosts :
       {"", "Host: 127.0.0.1\r\nHost: example.org\r\n", "Host: example.org\r\nHost: localhost\r\n"})
    EXPECT_TRUE(w.answer("GET " + w.path() + " HTTP/1.1\r\n" + hosts + "\r\n").starts_with("HTTP/1.1 400"))
        << hosts;
  for (const char* origin : {"http://example.org", "null", "", "https://127.0.0.1"})
    EXPECT_THROW(WebPeer(w.gateway.url(), w.path("live"), origin), boost::system::system_error) << origin;
  EXPECT_THROW(WebPeer(w.gateway.url(), "/wrong/live", "http://127.0.0.1"), boost::system::system_error);
  EXPECT_EQ(w.gateway.viewers(), 0u);
}

TEST(Gateway, SendsTheNewestFrameOnceTheLastIsPainted) {
  Watched w;
  w.ticks(50);
  WebPeer viewer(w.gateway.url());
  const WebFrame first = viewer.read();
  ASSERT_TRUE(first.slots.contains(kTrace));
  for (std::uint64_t version = 1; version <= 5; ++version) w.view.take_scene(scene_of(version, 4, 3));
  w.ticks(500);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(viewer.waiting(), 0u) << "sent without credit";
  viewer.painted(first.number);
  const WebFrame second = viewer.read();
  EXPECT_EQ(second.number, first.number + 1);
  ASSERT_TRUE(second.slots.contains(kMap) && second.slots.contains(kScene));
  EXPECT_EQ(second.slots.at(kMap).json["version"], 5) << "the newest alone";
  const nlohmann::json& trace = second.slots.at(kTrace).json;
  EXPECT_EQ(trace["first"].get<std::size_t>(),
            first.slots.at(kTrace).json["arrays"][0]["shape"][0].get<std::size_t>())
      << "rows go on where the last frame ended";
  EXPECT_GE(trace["arrays"][0]["shape"][0].get<int>(), 45);
}

// A frame of several packets waits for no acknowledgement (Nagle's algorithm: 40 ms on Linux).
TEST(Gateway, AFrameOfManyBytesComesAsSoonAsASmallOne) {
  Watched w;
  w.ticks(20);
  WebPeer viewer(w.gateway.url());
  std::uint32_t last = viewer.read().number;
  const auto turn_s = [&](auto&& news) {
    viewer.painted(last);
    news();
    const auto begin = std::chrono::steady_clock::now();
    last = viewer.read().number;
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  std::vector<double> small_s, large_s;
  for (std::uint64_t n = 1; n <= 41; ++n) {
    small_s.push_back(turn_s([&] { w.ticks(20); }));
    large_s.push_back(turn_s([&] { w.view.take_scene(scene_of(n, 40, 40)); }));
  }
  std::ranges::nth_element(small_s, small_s.begin() + 20);
  std::ranges::nth_element(large_s, large_s.begin() + 20);
  EXPECT_LT(large_s[20], 30 * small_s[20]) << small_s[20] << " s";
}

// Hidden for long: what it gets then is bounded.
TEST(Gateway, KeepsAMinuteAtMostForWhoComesBack) {
  Watched w;
  w.ticks(20);
  WebPeer viewer(w.gateway.url());
  const WebFrame first = viewer.read();
  w.ticks(200'000);
  viewer.painted(first.number);
  const WebFrame back = viewer.read();
  const std::size_t rows = back.slots.at(kTrace).json["arrays"][0]["shape"][0];
  EXPECT_EQ(rows, static_cast<std::size_t>(Trace::kKeptS / Trace::kRowS));
  float newest_s = 0;
  std::memcpy(&newest_s, back.slots.at(kTrace).data.data() + (rows - 1) * Trace::kColumns * sizeof(float),
              sizeof(float));
  EXPECT_NEAR(newest_s, 200.0F, 0.5F);
}

TEST(Gateway, AViewerThatStallsHoldsUpNoOther) {
  Watched w;
  std::vector<std::unique_ptr<WebPeer>> viewers;
  for (int n = 0; n < 10; ++n) viewers.push_back(std::make_unique<WebPeer>(w.gateway.url()));
  std::vector<std::uint32_t> numbers(viewers.size());
  for (int round = 0; round < 20; ++round) {
    w.view.take_scene(scene_of(static_cast<std::uint64_t>(round) + 1, 200, 200));
    w.ticks(20);
    for (std::size_t n = 1; n < viewers.size(); ++n) {  // the first reads and paints nothing
      if (numbers[n] > 0) viewers[n]->painted(numbers[n]);
      const WebFrame got = viewers[n]->read();
      EXPECT_EQ(got.number, numbers[n] + 1);
      numbers[n] = got.number;
    }
  }
  EXPECT_EQ(w.gateway.viewers(), viewers.size());
}

TEST(Gateway, LetsSoManyLookAndThenRefuses) {
  Watched w;
  std::vector<std::unique_ptr<WebPeer>> viewers;
  for (std::size_t n = 0; n < Gateway::kMaxViewers; ++n)
    viewers.push_back(std::make_unique<WebPeer>(w.gateway.url()));
  EXPECT_THROW(WebPeer(w.gateway.url()), boost::system::system_error);
  viewers.pop_back();
  EXPECT_TRUE(within(5, [&] { return w.gateway.viewers() < Gateway::kMaxViewers; }));
  EXPECT_NO_THROW(WebPeer(w.gateway.url()));
}

TEST(Gateway, CutsWhoSaysWhatNoPageSays) {
  Watched w;
  w.ticks(20);
  for (const std::string& said : {std::string("no json"), std::string("[]"), std::string(R"({"painted":-1})"),
                                  std::string(R"({"painted":"x"})"), std::string(1 << 20, 'x')}) {
    WebPeer viewer(w.gateway.url());
    const WebFrame first = viewer.read();
    const auto go_on = [&] {
      viewer.say(said);  // what is too long is cut while it is sent
      for (std::uint32_t number = first.number;; number = viewer.read().number) {
        viewer.painted(number);
        w.ticks(100);
      }
    };
    EXPECT_THROW(go_on(), boost::system::system_error) << said.substr(0, 20);
  }
  EXPECT_TRUE(within(5, [&] { return w.gateway.viewers() == 0; }));
  WebPeer viewer(w.gateway.url());
  viewer.say(R"({"fault":"stall"})");
  EXPECT_TRUE(within(5, [&] { return w.orders.size() == 1; }));
}

// A thousand that say nothing: those who look go on, and the process holds no more than it states.
TEST(Gateway, AThousandConnectionsDisturbNobodyWhoLooks) {
  Watched w;
  w.ticks(20);
  WebPeer viewer(w.gateway.url());
  std::uint32_t number = viewer.read().number;
  std::vector<std::unique_ptr<HttpPeer>> silent;
  for (int n = 0; n < 150; ++n)  // beyond what is open and what the system's queue holds, connecting waits
    silent.push_back(std::make_unique<HttpPeer>(test::port_of_url(w.gateway.url())));
  for (int round = 0; round < 50; ++round) {
    viewer.painted(number);
    w.ticks(20);
    number = viewer.read().number;
  }
  silent.clear();
  const auto answers = [&] { return w.get(w.path()).starts_with("HTTP/1.1 200"); };
  EXPECT_TRUE(within(10, answers));
  for (int hundred = 0; hundred < 9; ++hundred) {  // of more at once some wait for a second
    for (int n = 0; n < 100; ++n) HttpPeer(test::port_of_url(w.gateway.url())).send("GET /");
    EXPECT_TRUE(within(10, answers));
  }
}

// The oldest of those that have not shown the token goes for each that comes; nobody waits until their time
// is up.
TEST(Gateway, ConnectionsWithoutTheTokenGiveWay) {
  constexpr std::size_t kSilent = 100, kStay = Gateway::kMaxConnections - 2;
  Watched w;
  std::vector<std::unique_ptr<HttpPeer>> silent;
  for (std::size_t n = 0; n < kSilent; ++n)
    silent.push_back(std::make_unique<HttpPeer>(test::port_of_url(w.gateway.url())));
  EXPECT_TRUE(w.get(w.path()).starts_with("HTTP/1.1 200"));
  EXPECT_TRUE(silent.front()->closed());
  EXPECT_FALSE(silent[kSilent - kStay]->closed()) << "they were waited for";
}

}  // namespace
}  // namespace teletact::client
