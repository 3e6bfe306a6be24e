// Random numbers as functions of counters, as `random_words` of gs-core: the hash `pcg4d` of Jarzynski
// and Olano, Hash functions for GPU rendering, 2020.

fn mixed(words: vec4u) -> vec4u {
    var v = words;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

fn random_words(counter: vec4u) -> vec4u {
    let v = mixed(counter * 1664525u + 1013904223u);
    return mixed(v ^ (v >> vec4u(16u)));
}
