// Who looks on at a scene: its windows and maps, what is felt there, how the tissue gives way; with a credit
// of one, whatever they do.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <future>
#include <limits>
#include <optional>
#include <set>
#include <thread>

#include "service/rpc/scene_news.h"
#include "tests/rpc/running_server.h"
#include "tests/scene/windows.h"
#include "tests/support/observation_reader.h"

namespace teletact::service {
namespace {

using grpc::StatusCode;

const std::vector<const char*> kMaps{"youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode"};

v1::ObserveOpen everything(const std::string& scene) {
  v1::ObserveOpen open;
  open.set_scene_id(scene);
  open.set_windows(true), open.set_answers(true), open.set_surface(true);
  for (const char* map : kMaps) open.add_maps(map);
  return open;
}

template <class T>
std::vector<T> numbers(const v1::Array& array) {
  std::vector<T> out(array.data().size() / sizeof(T));
  std::memcpy(out.data(), array.data().data(), array.data().size());
  return out;
}

// A scene's map put together from its parts, on the grid of `whole`.
struct Assembled {
  explicit Assembled(const v1::Map& whole)
      : nx(whole.grid().size(0)),
        ny(whole.grid().size(1)),
        dx_m(whole.grid().spacing_m(0)),
        pa(nx * ny, 0.0F) {}
  void draw(const v1::Map& part) {
    const auto values = numbers<float>(part.values());
    const auto begin = static_cast<std::size_t>(std::lround(part.grid().origin_m(0) / dx_m - 0.5));
    const std::size_t columns = part.grid().size(0);
    ASSERT_EQ(part.grid().size(1), ny);
    for (std::size_t j = 0; j < ny; ++j)
      for (std::size_t i = 0; i < columns; ++i) pa.at(begin + i + nx * j) = values.at(i + columns * j);
  }
  std::size_t nx, ny;
  double dx_m;
  std::vector<float> pa;
};

class Observing : public OnOneServer {
 protected:
  static void SetUpTestSuite() {
    Limits limits;
    limits.max_observers = 3;
    serve(limits);
  }
  struct Observer {
    explicit Observer(const v1::ObserveOpen& open) : stub(v1::Palpation::NewStub(server->channel())) {
      set_deadline(context);
      reader.emplace(*stub, context, open);
    }
    ~Observer() { context.TryCancel(); }
    // Reads on until `wanted`; states count up meanwhile.
    template <class Wanted>
    v1::Observation until(Wanted wanted) {
      v1::Observation state;
      do {
        EXPECT_TRUE(reader->read(&state));
        EXPECT_EQ(state.state(), ++states);
      } while (!HasFailure() && !wanted(state));
      return state;
    }
    std::unique_ptr<v1::Palpation::Stub> stub;
    grpc::ClientContext context;
    std::optional<ObservationReader> reader;
    std::uint64_t states = 0;
  };
  // Twice, so far apart that the second is told to observers.
  static bool press(Toucher& hand, double x_m, double y_m, v1::TouchAnswer* felt) {
    if (!hand.touch(x_m, y_m, felt)) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return hand.touch(x_m, y_m, felt);
  }
  static grpc::Status refused(const v1::ObserveOpen& open) {
    Observer observer(open);
    v1::Observation state;
    EXPECT_FALSE(observer.reader->read(&state));
    return observer.reader->finish();
  }
  static v1::Scene full(const std::string& id) {
    grpc::ClientContext context;
    set_deadline(context);
    v1::GetSceneRequest request;
    request.set_scene_id(id);
    request.set_view(v1::SCENE_VIEW_FULL);
    v1::Scene scene;
    EXPECT_TRUE(v1::Palpation::NewStub(server->channel())->GetScene(&context, request, &scene).ok());
    return scene;
  }
  // An empty scene of 200 mm to publish into.
  static std::shared_ptr<Scene> empty_scene(const std::string& id) {
    v1::CreateSceneRequest request;
    request.set_scene_id(id);
    for (const double size_m : {0.2, 0.03}) request.mutable_geometry()->add_size_m(size_m);
    EXPECT_TRUE(server->create(request).ok());
    return (*server)->core().scenes.find(id);
  }
  static WindowEstimate window(double x_m, double modulus_pa, std::uint8_t grey) {
    WindowEstimate estimate = window_of(homogeneous(modulus_pa), x_m, 0.02, 0.03);
    estimate.b_mode = {{40, 100, 0.25e-3, 1e-3, 0.5e-3, 0.28e-3}, std::vector<std::uint8_t>(4000, grey)};
    return estimate;
  }
};

// Where who says nothing is ended soon.
class ObservingInTime : public Observing {
 protected:
  static void SetUpTestSuite() {
    Limits limits;
    limits.acknowledge_s = limits.first_message_s = 0.5;
    serve(limits);
  }
};

TEST_F(Observing, WindowsAndMapsComeOnceAndAgainWhereTheyChange) {
  // GIVEN an empty scene, an observer of it
  const auto scene = empty_scene("growing");
  Observer observer(everything("growing"));
  EXPECT_EQ(observer.until([](const auto& s) { return s.has_scene(); }).scene().windows_size(), 0);
  // WHEN two windows are published, far from each other
  scene->publish(window(0.0, 1e4, 10));
  scene->publish(window(0.15, 2e4, 20));
  std::optional<Assembled> felt;
  felt.emplace(full("growing").youngs_modulus());
  std::set<std::uint64_t> images;
  std::uint64_t version = 0;
  const auto take = [&](const v1::Observation& state) {
    for (const v1::ObservedMap& part : state.maps()) {
      EXPECT_GT(part.version(), 0U);
      if (part.map().name() == "youngs_modulus") felt->draw(part.map());
      if (part.map().name() == "b_mode") images.insert(part.window_id());
      EXPECT_LE(part.version(), state.scene_version());
    }
    if (state.has_scene()) version = state.scene().version();
  };
  observer.until([&](const auto& state) {
    take(state);
    return images.size() == 2 && version == scene->snapshot()->version;
  });
  // THEN the parts make up the scene's map
  EXPECT_EQ(felt->pa, numbers<float>(full("growing").youngs_modulus().values()));
  EXPECT_EQ(full("growing").b_mode_size(), 2);
  EXPECT_EQ(full("growing").youngs_modulus_log_std().grid().size(0), felt->nx);
  // AND one that is published again comes alone: its image, and its columns
  const Published again = scene->publish(window(0.15, 3e4, 30));
  images.clear();
  std::size_t columns = 0;
  const v1::Observation last = observer.until([&](const auto& state) {
    take(state);
    for (const auto& part : state.maps())
      if (part.map().name() == "valid") columns += part.map().grid().size(0);
    return !images.empty() && version == again.version;
  });
  EXPECT_EQ(images, std::set{again.window_id});
  EXPECT_LE(columns, 2 * CellBlocks::kColumns);
  EXPECT_EQ(felt->pa, numbers<float>(full("growing").youngs_modulus().values()));
  for (const auto& part : last.maps())
    if (part.map().name() == "b_mode") {
      EXPECT_EQ(part.map().values().dtype(), v1::DATA_TYPE_UINT8);
      EXPECT_DOUBLE_EQ(part.map().grid().origin_m(0), 0.15 + 0.25e-3) << "in the scene";
      EXPECT_EQ(numbers<std::uint8_t>(part.map().values()), std::vector<std::uint8_t>(4000, 30));
    }
  // AND where nothing changes, states come all the same, with nothing in them
  const v1::Observation quiet = observer.until([](const auto&) { return true; });
  EXPECT_FALSE(quiet.has_scene());
  EXPECT_EQ(quiet.maps_size(), 0);
  EXPECT_FALSE(quiet.steered());
}

TEST_F(Observing, WhatIsFeltAndHowTheTissueGivesWayAreSeen) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.set_session_id("hand");
  Toucher hand(channel, open);
  ASSERT_TRUE(hand.opened());
  Observer observer(everything("s"));
  v1::TouchAnswer felt;
  // WHEN a finger presses: one touch and one look after the other
  v1::Observation seen;
  double deepest_m = 0;
  std::size_t answers = 0;
  for (int k = 0; k < 2000 && (answers < 3 || deepest_m == 0) && !HasFailure(); ++k) {
    ASSERT_TRUE(press(hand, 0.05, 0.003, &felt));
    ASSERT_TRUE(observer.reader->read(&seen));
    EXPECT_EQ(seen.steered_by(), "hand");
    EXPECT_TRUE(seen.steered());
    if (seen.has_answer() && seen.answer().status() != v1::TOUCH_STATUS_PREPARING) {
      // THEN the observer gets an answer that the hand got
      EXPECT_LE(seen.answer().answer(), felt.answer());
      EXPECT_EQ(seen.answer().pressure_size(), 0);
      EXPECT_TRUE(seen.answer().steers());
      ASSERT_EQ(seen.answer().force_n_size(), 3);
      EXPECT_NEAR(seen.answer().force_n(1), felt.force_n(1), 1e-9);
      ++answers;
    }
    if (seen.has_surface() && seen.surface().x_m_size() > 0) {
      const v1::DeformedSurface& s = seen.surface();
      const auto moved_m = numbers<float>(s.displacement_m());
      ASSERT_EQ(moved_m.size(), std::size_t(s.x_m_size() * s.z_m_size()));
      deepest_m = *std::ranges::max_element(moved_m);
      const auto at = std::ranges::max_element(moved_m) - moved_m.begin();
      EXPECT_NEAR(s.x_m(int(at)), 0.05, 0.0011);
    }
  }
  // AND a surface that gives way as deep as the tip, up to its skin
  EXPECT_NEAR(deepest_m, 0.003, 0.0003);
  EXPECT_GE(answers, 3U);
  // AND one at rest once the finger is lifted
  bool rests = false;
  for (int k = 0; k < 2000 && !rests; ++k) {
    ASSERT_TRUE(press(hand, 0.05, -0.002, &felt));
    ASSERT_TRUE(observer.reader->read(&seen));
    rests = seen.has_surface() && seen.surface().x_m_size() == 0;
  }
  EXPECT_TRUE(rests);
}

TEST_F(Observing, OneOfTwoHandsIsLookedAtByName) {
  std::vector<std::unique_ptr<Toucher>> hands;
  for (const char* name : {"anna", "berta"}) {
    v1::TouchOpen open = Toucher::open_on("s");
    open.set_session_id(name);
    hands.push_back(std::make_unique<Toucher>(channel, open));
    ASSERT_TRUE(hands.back()->opened());
  }
  v1::ObserveOpen of_berta;
  of_berta.set_scene_id("s"), of_berta.set_answers(true), of_berta.set_session_id("berta");
  v1::ObserveOpen of_who_steers = of_berta;
  of_who_steers.clear_session_id();
  Observer berta(of_berta), steering(of_who_steers);
  v1::TouchAnswer felt;
  const auto see = [&](Observer& observer) {
    v1::Observation seen;
    for (int k = 0; k < 2000; ++k) {
      EXPECT_TRUE(press(*hands[0], 0.03, 0.002, &felt));
      EXPECT_TRUE(press(*hands[1], 0.07, 0.002, &felt));
      EXPECT_TRUE(observer.reader->read(&seen));
      EXPECT_EQ(seen.maps_size(), 0);
      EXPECT_FALSE(seen.has_surface() || seen.has_scene()) << "nobody asked for it";
      if (seen.has_answer()) return seen.answer().position_m(0);
    }
    return 0.0;
  };
  EXPECT_EQ(see(steering), 0.03);
  EXPECT_EQ(see(berta), 0.07);
}

TEST_F(ObservingInTime, WhoStopsReadingIsOneStateBehindAndEnds) {
  Toucher hand(channel, "s");
  ASSERT_TRUE(hand.opened());
  Observer lazy(everything("s"));
  v1::Observation state;
  std::size_t states = 0;
  std::jthread moving([&](const std::stop_token& stop) {
    v1::TouchAnswer felt;
    for (int k = 0; !stop.stop_requested(); ++k)
      EXPECT_TRUE(hand.touch(0.05, 0.001 + 1e-6 * (k % 100), &felt));
  });
  while (lazy.reader->read_on(&state)) ++states;
  EXPECT_EQ(states, 1U);
  expect_refused(lazy.reader->finish(), StatusCode::DEADLINE_EXCEEDED, "acknowledged");
}

TEST_F(Observing, WhatCannotBeIsRefusedByItsField) {
  // A refused stream's place comes back after its status.
  const auto with = [](auto change) {
    v1::ObserveOpen open = everything("s");
    change(open);
    server->expect_all_calls_end();
    return refused(open);
  };
  expect_refused(with([](auto& o) { o.set_scene_id("nowhere"); }), StatusCode::NOT_FOUND, "nowhere");
  expect_refused(with([](auto& o) { o.add_maps("colour"); }), StatusCode::INVALID_ARGUMENT, "open.maps");
  expect_refused(with([](auto& o) { o.add_maps("valid"); }), StatusCode::INVALID_ARGUMENT, "open.maps");
  for (const double rate_hz : {-1.0, 0.01, 61.0, std::nan(""), std::numeric_limits<double>::infinity()})
    expect_refused(with([&](auto& o) { o.set_max_rate_hz(rate_hz); }), StatusCode::INVALID_ARGUMENT,
                   "open.max_rate_hz");
  expect_refused(with([](auto& o) { o.set_session_id(std::string(1000, 'x')); }),
                 StatusCode::INVALID_ARGUMENT, "open.session_id");
  v1::ObserveRequest request;
  const auto second = [&] {
    server->expect_all_calls_end();
    Observer observer(everything("s"));
    observer.reader->send(request);
    return observer.reader->finish();
  };
  expect_refused(second(), StatusCode::INVALID_ARGUMENT, "kind");
  *request.mutable_open() = everything("s");
  expect_refused(second(), StatusCode::INVALID_ARGUMENT, "sent twice");
  request.set_acknowledged(77);
  expect_refused(second(), StatusCode::INVALID_ARGUMENT, "acknowledged");
}

TEST_F(ObservingInTime, WhoSaysNothingEnds) {
  grpc::ClientContext context;
  set_deadline(context);
  const auto stub = v1::Palpation::NewStub(channel);
  const auto stream = stub->Observe(&context);
  v1::Observation state;
  EXPECT_FALSE(stream->Read(&state));
  expect_refused(stream->Finish(), StatusCode::DEADLINE_EXCEEDED, "open");
}

// Who comes and goes leaves nothing to do, and nothing that is held.
TEST_F(Observing, WhatSomebodyWaitedForWhoHasGoneIsNotMade) {
  ASSERT_TRUE(server->create(uniform_scene("left")).ok());
  Core& core = (*server)->core();
  std::weak_ptr<Scene> scene = core.scenes.find("left");
  std::promise<void> begun, release;
  Workers busy;
  busy.post([&] {
    begun.set_value();
    release.get_future().wait();
  });
  begun.get_future().wait();
  {
    SceneNews news(core, busy, scene.lock(), "anna", everything("left"));
    news.look();
  }
  ASSERT_TRUE(server->remove("left").ok());
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (!scene.expired() && std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_TRUE(scene.expired()) << "work that waits holds it";
  release.set_value();
}

TEST_F(Observing, PlacesAreCountedAndADeletedSceneEndsThem) {
  ASSERT_TRUE(server->create(uniform_scene("gone")).ok());
  std::vector<std::unique_ptr<Observer>> all;
  v1::Observation state;
  for (int k = 0; k < 3; ++k) {
    all.push_back(std::make_unique<Observer>(everything("gone")));
    ASSERT_TRUE(all.back()->reader->read(&state));
  }
  expect_refused(refused(everything("gone")), StatusCode::RESOURCE_EXHAUSTED, "observers of scenes");
  ASSERT_TRUE(server->remove("gone").ok());
  for (const auto& observer : all) {
    while (observer->reader->read(&state)) {
    }
    expect_refused(observer->reader->finish(), StatusCode::ABORTED, "deleted");
  }
}

}  // namespace
}  // namespace teletact::service
