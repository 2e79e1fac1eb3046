import{a,b,c}from"./chunk-S2M7QHU7.js";import"./chunk-WYZ6NXQQ.js";import"./chunk-FKRIOQYB.js";export{c as Live,b as LiveFigures,a as WALL};
