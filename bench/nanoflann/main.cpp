// nanoflann's part of the benchmark: neighbour search.
#include <algorithm>
#include <cmath>
#include <memory>
#include <nanoflann.hpp>
#include <runner.hpp>
#include <thread>
#include <utility>

namespace {

struct Points {
  std::vector<float> xyz;

  std::size_t kdtree_get_point_count() const { return xyz.size() / 3; }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const { return xyz[3 * i + axis]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3, std::uint32_t>;

constexpr std::size_t NEIGHBOURS = 20;

// Points in a leaf: its documentation advises 10 to 50.
constexpr std::size_t LEAF = 40;

// 1.5 renamed these, and builds on several threads.
#if NANOFLANN_VERSION >= 0x150
using Search = nanoflann::SearchParameters;
using Found = nanoflann::ResultItem<std::uint32_t, float>;
constexpr auto BUILT = "";

nanoflann::KDTreeSingleIndexAdaptorParams parameters(int threads) {
  return {LEAF, nanoflann::KDTreeSingleIndexAdaptorFlags::None, static_cast<unsigned>(threads)};
}
#else
using Search = nanoflann::SearchParams;
using Found = std::pair<std::uint32_t, float>;
constexpr auto BUILT = "no threads";

nanoflann::KDTreeSingleIndexAdaptorParams parameters(int) { return {LEAF}; }
#endif

// The constructor builds the tree.
std::unique_ptr<Tree> build(const Points& points, int threads) { return std::make_unique<Tree>(3, points, parameters(threads)); }

// Calls `ask(from, to)` on each of `threads` threads with an even share of the probes.
template <class Ask>
void split(std::size_t probes, int threads, Ask ask) {
  const auto n = static_cast<std::size_t>(threads);
  std::vector<std::thread> running;
  for (std::size_t t = 1; t < n; ++t) running.emplace_back([=] { ask(probes * t / n, probes * (t + 1) / n); });
  ask(std::size_t{0}, probes / n);
  for (auto& thread : running) thread.join();
}

// Times the number that `asker(tree)`, made anew on each thread, has for each probe.
template <class T, class Asker>
void ask(const bench::Arguments& args, Asker asker) {
  const Points points{bench::array<float>(args.file("map.f32"))};
  const auto probes = bench::array<float>(args.file("probes.f32"));
  const auto tree = build(points, args.threads);
  const std::size_t n = probes.size() / 3;
  bench::measure(
      args, "probes split over std::thread",
      [&] {
        std::vector<T> answers(n);
        split(n, args.threads, [&](std::size_t from, std::size_t to) {
          auto one = asker(*tree);
          for (std::size_t i = from; i < to; ++i) answers[i] = one(&probes[3 * i]);
        });
        return answers;
      },
      [](const std::vector<T>& answers) { return bench::output(answers, answers.size()); });
}

void tree(const bench::Arguments& args) {
  const Points points{bench::array<float>(args.file("map.f32"))};
  bench::measure(
      args, BUILT, [&] { return build(points, args.threads); },
      [](const std::unique_ptr<Tree>& tree) { return bench::Output{{}, tree->size(*tree)}; });
}

void nearest(const bench::Arguments& args) {
  ask<float>(args, [](const Tree& tree) {
    return [&tree](const float* probe) {
      std::uint32_t index = 0;
      float squared = 0.0f;
      tree.knnSearch(probe, 1, &index, &squared);
      return std::sqrt(squared);
    };
  });
}

void knn(const bench::Arguments& args) {
  ask<float>(args, [](const Tree& tree) {
    return [&tree](const float* probe) {
      std::uint32_t indices[NEIGHBOURS];
      float squared[NEIGHBOURS];
      const std::size_t found = tree.knnSearch(probe, NEIGHBOURS, indices, squared);
      float sum = 0.0f;
      for (std::size_t i = 0; i < found; ++i) sum += std::sqrt(squared[i]);
      return sum;
    };
  });
}

void radius(const bench::Arguments& args) {
  const auto length = static_cast<float>(3.0 * bench::setting(args, "voxel"));
  ask<std::uint32_t>(args, [length](const Tree& tree) {
    Search unsorted;
    unsorted.sorted = false;
    return [&tree, length, unsorted, found = std::vector<Found>()](const float* probe) mutable {
      return static_cast<std::uint32_t>(tree.radiusSearch(probe, length * length, found, unsorted));
    };
  });
}

}  // namespace

int main(int argc, char** argv) {
  return bench::run(argc, argv, "nanoflann", NANOFLANN_PACKAGE, {{"tree", tree}, {"nearest", nearest}, {"knn", knn}, {"radius", radius}});
}
