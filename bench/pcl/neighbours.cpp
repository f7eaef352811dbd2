// Neighbour search, by the tree that PCL's features and registration search in by default.
#include <pcl/kdtree/kdtree_flann.h>

#include <cmath>

#include "stages.hpp"

namespace stages {

namespace {

using Tree = pcl::KdTreeFLANN<pcl::PointXYZ>;

std::unique_ptr<Tree> build(const Cloud::Ptr& cloud) {
  auto tree = std::make_unique<Tree>(false);
  tree->setInputCloud(cloud);
  return tree;
}

// Times `one(tree, probe, indices, squared distances)` asked of every probe.
template <class T, class One>
void ask(const bench::Arguments& args, One one) {
  const Cloud::Ptr probes = cloud(args, "probes.f32");
  const auto tree = build(cloud(args, "map.f32"));
  bench::measure(
      args, "KdTreeFLANN, unsorted; probes split over OpenMP",
      [&] {
        std::vector<T> answers(probes->size());
#pragma omp parallel num_threads(args.threads)
        {
          pcl::Indices indices;
          std::vector<float> squared;
#pragma omp for schedule(dynamic, 256)
          for (std::ptrdiff_t i = 0; i < static_cast<std::ptrdiff_t>(probes->size()); ++i) {
            answers[i] = one(*tree, (*probes)[i], indices, squared);
          }
        }
        return answers;
      },
      [](const std::vector<T>& answers) { return bench::output(answers, answers.size()); });
}

}  // namespace

void tree(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map.f32");
  bench::measure(
      args, "KdTreeFLANN; no threads", [&] { return build(map); },
      [&](const std::unique_ptr<Tree>&) { return bench::Output{{}, map->size()}; });
}

void nearest(const bench::Arguments& args) {
  ask<float>(args, [](const Tree& tree, const pcl::PointXYZ& probe, pcl::Indices& indices, std::vector<float>& squared) {
    tree.nearestKSearch(probe, 1, indices, squared);
    return std::sqrt(squared[0]);
  });
}

void knn(const bench::Arguments& args) {
  ask<float>(args, [](const Tree& tree, const pcl::PointXYZ& probe, pcl::Indices& indices, std::vector<float>& squared) {
    tree.nearestKSearch(probe, NEIGHBOURS, indices, squared);
    float sum = 0.0f;
    for (const float s : squared) sum += std::sqrt(s);
    return sum;
  });
}

void radius(const bench::Arguments& args) {
  const double length = 3.0 * bench::setting(args, "voxel");
  ask<std::uint32_t>(args, [length](const Tree& tree, const pcl::PointXYZ& probe, pcl::Indices& indices, std::vector<float>& squared) {
    return static_cast<std::uint32_t>(tree.radiusSearch(probe, length, indices, squared));
  });
}

}  // namespace stages
