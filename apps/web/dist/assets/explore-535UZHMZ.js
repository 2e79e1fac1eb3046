import"./chunk-KHNENPYX.js";import{O as t,y as e}from"./chunk-EXJ3EDRR.js";function o(){return e(t,{title:"Explore",text:"This page is being built."})}export{o as Explore};
