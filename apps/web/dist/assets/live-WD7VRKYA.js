import{a,b,c}from"./chunk-7JOSKLPL.js";import"./chunk-EI3MMVHP.js";import"./chunk-OGVLQXYF.js";export{c as Live,b as LiveFigures,a as WALL};
